"""Systems made at random have the spectrum of the directly assembled matrices; `tests/joined_at_random.py` looks longer."""

from __future__ import annotations

import pytest
from joined_at_random import METHODS, findings


@pytest.mark.sampled(12)
@pytest.mark.parametrize("seed", range(15))
def test_complete_parts_joined_at_random(seed: int) -> None:
    assert findings(seed, sorted(METHODS)[seed % 3::3]) == []


@pytest.mark.parametrize(("seed", "key"), [
    (28, "dual-craig-bampton"),  # a coordinate of the system is rigid motion, and its stiffness what a cancellation leaves
    (111, "craig-chang"),  # a port that the joints hold, of a system within the system
    (160, "craig-chang")])
def test_seeds_that_were_wrong(seed: int, key: str) -> None:
    assert findings(seed, [key]) == []


@pytest.mark.slow
def test_a_mass_that_is_the_square_of_a_rounding_is_none() -> None:
    """It moved the complex eigenvalues under the belt: a pole of its own, at 1e15."""
    assert findings(187, sorted(METHODS)) == []


@pytest.mark.slow
def test_a_trace_of_elastic_motion_does_not_stiffen_a_rigid_one() -> None:
    """It came by the change to coordinates that are the open interface, where K was changed and not assembled anew."""
    assert findings(243, sorted(METHODS)) == []
