"""The quick ones of `python -m benchmarks extreme`: right within a stated bound, or refused with the known reason."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

import femsub as fs
from benchmarks.extreme import CASES, Case, copies, damped, edge, evaluate, mixed
from benchmarks.judges import Found, Sturm, border, cea, matched, modes, mp, quadratic

ROOT = Path(__file__).parent.parent

#: Of the quick ones, those that take longest; a case like each of them remains.
LONGEST = {"CEA, sixfold on edges, sparse", "ring of 240, a pair cut"}

assert set(CASES) >= LONGEST


@pytest.mark.sampled(12)
@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow if name in LONGEST else ())
                                  for name, case in CASES.items() if case.quick])
def test_case(name: str) -> None:
    row = evaluate(name)
    assert row["verdict"] == ("right" if CASES[name].expect == "right" else "refused"), row["reason"]
    assert row["as_known"], row["reason"]


def test_the_table_is_long_enough_and_covers_every_group() -> None:
    assert len(CASES) >= 165
    groups = ["ratios", "units", "massless", "rigid", "interface", "repeated", "edges", "border", "damping", "defective",
              "slender", "large"]
    assert {case.group for case in CASES.values()} == {*groups, "modes 0, 1, all"}


def test_sturm_counts_and_finds_planted_errors() -> None:
    sub = fs.chain(30)
    sturm, exact = Sturm(sub.K, sub.M), fs.chain_frequencies(30) ** 2
    assert [sturm.count(float(value) * 1.000001) for value in exact] == list(range(1, 31))
    assert sturm.errors(exact).max() < 1e-14
    assert sturm.errors(exact[:3] * (1 + 1e-9)) == pytest.approx([1e-9] * 3, rel=0.3)
    assert sturm.errors(exact[1:3]).min() > 0.5  # the first is missing: numbers no longer fit


def test_companion_matrix_and_border_are_right() -> None:
    sub = fs.chain(4, belt=2)
    parts = [part.toarray() for part in (sub.M, sub.D, sub.K)]
    plain = la.eigvals(np.block([[np.zeros((4, 4)), np.eye(4)], [-parts[2], -parts[1]]]))
    distance, partner = matched(plain, quadratic(*parts))
    assert distance.max() < 1e-14 and sorted(partner) == list(range(8))
    c, moved = border(*parts, sub.port("belt"), fs.critical_slope(sub).omega * (1 + 1e-7))
    spectrum = quadratic(parts[0], parts[1] + float(c) * np.diag([0, 1.0, 0, 0]), parts[2])
    assert min(abs(mp.re(value)) for value in spectrum) < 1e-16 and 1e-17 < moved < 1e-12


def test_companion_matrix_where_mass_and_stiffness_are_singular() -> None:
    M, K = np.diag([1.0, 0.0, 2.0]), np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    found = sorted((complex(value) for value in quadratic(M, 0 * K, K)), key=abs)
    assert np.abs(found[:2]).max() < 1e-15 and np.abs(found[2:]) == pytest.approx([np.sqrt(0.75)] * 2, rel=1e-14)


def test_sets_are_compared_one_to_one_and_edges_belong_to_the_band() -> None:
    """A spectrum that is not the model's: one eigenvalue too few, one too many on an edge, one beyond it, one that moved."""
    pencil, values = damped(copies(12, 1, sparse=False), 1e-3)
    omega = fs.chain_frequencies(12)
    band = (0.0, edge(omega[3], 1e-3))
    top = np.argmin(np.abs(values - (-5e-4 + 1j * band[1])))
    near = values * np.where(np.arange(len(values)) == top, 1 + 1e-3, 1)
    assert cea(lambda: (pencil, values), band=band).ratio < 1
    assert "do not exist" in cea(lambda: (pencil, values[values.imag < band[1] * (1 - 1e-9)][-3:]), band=band).lie
    assert cea(lambda: (pencil, np.append(values, values[top])), band=band).missed == 1
    assert "outside" in cea(lambda: (pencil, near), band=band).lie
    assert cea(lambda: (pencil, near)).ratio > 1
    sub, exact = copies(12, 1, sparse=False)
    assert modes(lambda: (sub, np.append(exact, exact[2])), band=(0.0, exact[3])).missed == 1
    assert "counted below" in modes(lambda: (sub, exact[1:]), band=(0.0, exact[3])).lie


def test_mixed_oscillators_are_what_they_say() -> None:
    pencil, values = mixed([(1.0, 0.5, 4.0), (0.0, 3.0, 1.0), (0.0, 0.0, 2.0)], 3)
    assert sorted(values.real) == pytest.approx([-1 / 3, -0.25, -0.25])
    assert matched(values, quadratic(pencil.M, pencil.D, pencil.K))[0].max() < 1e-12


@pytest.mark.parametrize(("worse", "reason"), [
    ({"ratio": 1.1}, "1.1 times its bound"), ({"missed": 1}, "1 missed"), ({"lie": "no"}, "no"), ({"bound": 1.0}, "says nothing"),
    ({"orthogonality": 1e-7}, "ΦᵀMΦ"), ({"backward": 1e-8}, "backward error")])
def test_what_is_wrong_is_called_wrong(worse: dict, reason: str, monkeypatch: pytest.MonkeyPatch) -> None:
    good = {"computed": "", "error": 0.0, "bound": 1e-12, "ratio": 0.1, "why": ""}
    monkeypatch.setitem(CASES, "planted", Case("planted", "ratios", lambda: Found(**(good | worse))))
    assert evaluate("planted")["verdict"] == "wrong" and reason in evaluate("planted")["reason"]
    monkeypatch.setitem(CASES, "planted", Case("planted", "ratios", lambda: Found(**good)))
    assert evaluate("planted")["verdict"] == "right"
    monkeypatch.setitem(CASES, "planted", Case("planted", "ratios", lambda: np.linalg.inv(np.zeros((2, 2)))))
    assert evaluate("planted")["verdict"] == "wrong"


@pytest.mark.slow
def test_script(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks", "extreme", "--cases", "just restraining", "a negative spring", "triple",
               "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 cases in" in done.stdout and "2 right within their bounds, 1 refused with the reason, 0 wrong" in done.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"extreme.csv", "extreme.json"}
    rows = {row["case"]: row for row in json.loads((tmp_path / "extreme.json").read_text())["rows"]}
    assert rows["a negative spring"]["reason"].startswith("SingularMatrixError: K - σM is not positive definite")
    assert rows["triple eigenvalue"]["error"] < rows["triple eigenvalue"]["bound"] < 1e-3
