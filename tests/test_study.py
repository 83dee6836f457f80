"""The study: spectra matched as sets, errors, times that belong to what they say."""

from __future__ import annotations

import numpy as np
import pytest

import femsub as fs
from femsub.studies import match, spectrum_errors


def test_spectra_are_matched_as_sets(rng: np.random.Generator) -> None:
    reference = rng.standard_normal(20) + 1j * rng.standard_normal(20)
    order = rng.permutation(20)
    at, to = match(reference, reference[order] + 1e-9)
    assert np.array_equal(order[to], at)


def test_errors_shrink_and_vanish_with_all_modes() -> None:
    methods = [kind(modes) for kind in (fs.CraigBampton, fs.CraigChang) for modes in (4, 6, 9)]
    found = fs.study(fs.chain(10, belt=2), methods, band=(0.0, 0.75), belt=fs.Belt(slope=-0.2677), repeats=3)
    assert len(found.rows) == 6 and found.full.size == 10 and found.repeats == 3
    for rows in (found.rows[:3], found.rows[3:]):
        for key in ("error_eigenvalue", "error_growth", "error_slope"):
            errors = [getattr(row, key) for row in rows]
            assert errors[0] > errors[1] > errors[2] < 1e-10
        assert all(row.missing == 0 and row.reduction.least <= row.reduction.median <= row.reduction.most for row in rows)
    assert found.rows[0].error_slope == pytest.approx(2.7e-3, abs=5e-5)
    assert found.rows[0].method == "CraigBampton" and "10 DOF" in repr(found)


def test_a_mode_that_the_reduced_model_lacks_is_counted() -> None:
    sub = fs.chain(10, belt=2)
    with pytest.warns(fs.PortWarning):
        rom = fs.reduce(sub, fs.CraigBampton(1))
    full = fs.complex_modes(sub, band=(0.0, 0.75))
    assert spectrum_errors(full, fs.complex_modes(rom))[2] == 1
    assert spectrum_errors(full, fs.complex_modes(sub)) == (0.0, 0.0, 0)


def test_refusals() -> None:
    with pytest.raises(ValueError, match="methods is empty"):
        fs.study(fs.chain(10), [], band=(0, 1))
    with pytest.raises(ValueError, match="repeats must be at least 1"):
        fs.study(fs.chain(10), [fs.CraigChang(2)], band=(0, 1), repeats=0)
    with pytest.raises(ValueError, match="unknown port 'bel'; did you mean 'belt'"):
        fs.study(fs.chain(10), [fs.CraigChang(2)], band=(0, 1), port="bel")
    with pytest.raises(TypeError, match="takes a Substructure"):
        fs.study(fs.chain(10).K, [fs.CraigChang(2)], band=(0, 1))


def test_the_slope_of_a_study_is_per_unit_of_the_belt_s_force() -> None:
    found = fs.study(fs.chain(10, belt=2), [fs.CraigChang(9)], band=(0.0, 0.75), belt=fs.Belt(force=2.0, slope=-0.1), repeats=1)
    assert 2 * found.full.slope == pytest.approx(-0.025567, abs=1e-6)
