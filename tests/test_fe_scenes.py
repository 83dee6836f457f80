"""The scenes beam, plate and solid: what is asked is computed, shown and written; shapes come back; bad input leaves nothing."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import femsub as fs
from femsub.app.cli import main
from femsub.app.grammar import Scene
from femsub.components.fields import displacements
from femsub.modes.quadratic.matching import extra_eigenvalues
from femsub.studies.results import Row, Study, Timing, with_front

SMALL = {
    "beam": 'scene = "beam"\n[part.beam]\nelements = 40\n[reduce]\nmodes = [8, 12]\nrepeats = 1\n',
    "plate": 'scene = "plate"\n[part.plate]\nplate = {lengths = [0.4, 0.3], elements = [12, 9]}\n'
             '[reduce]\nmodes = [8, 16]\nrepeats = 1\n',
    "solid": 'scene = "solid"\n[part.disc]\nsolid = {radii = [0.05, 0.15], thickness = 0.012, elements = [2, 12, 1]}\n'
             '[reduce]\nmodes = [10, 20]\nrepeats = 1\n',
}
NAMES = ["beam", pytest.param("plate", marks=pytest.mark.slow), pytest.param("solid", marks=pytest.mark.slow)]  # as `runs` is
TABLES = {"modes", "critical", "complex-modes", "compare", "springs"}
PICTURES = TABLES | {"complex-modes-shape"}


def asking(text: str, *asks: str) -> str:
    """The same with other asks."""
    return text + "".join(f"[[ask]]\n{ask}\n" for ask in asks)


def scene_file(folder: Path, text: str) -> str:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


class Runs(dict[str, tuple[Path, str]]):
    """The folder that a scene wrote and what it printed; each scene is run when it is first asked for."""

    def __init__(self, folders: pytest.TempPathFactory) -> None:
        super().__init__()
        self.folders = folders

    def __missing__(self, name: str) -> tuple[Path, str]:
        folder = self.folders.mktemp(name)
        with redirect_stdout(io.StringIO()) as out, redirect_stderr(io.StringIO()) as err:
            status = main(["run", "-v", scene_file(folder, SMALL[name]), "--out", str(folder / "out")])
        assert status == 0 and "warning" not in err.getvalue(), err.getvalue()
        self[name] = folder / "out", out.getvalue()
        return self[name]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return Runs(tmp_path_factory)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_files_and_figures(runs: Runs, name: str) -> None:
    folder, _ = runs[name]
    growing = len(json.loads((folder / "results.json").read_text())["complex-modes"]["unstable"])
    assert min(growing, 2) == {"beam": 2, "plate": 1, "solid": 0}[name]
    listed = {"complex-modes-unstable.csv"} if growing else set()
    drawn = {"complex-modes-unstable.png", "complex-modes-unstable.vtu"} if growing > 1 else set()  # beside the shape of one
    assert {path.name for path in folder.iterdir()} == listed | drawn | {
        "results.json", *(f"{table}.csv" for table in TABLES), "modes.vtu", "complex-modes-shape.vtu",
        "complex-modes-shape.pvd", "complex-modes-shape", *(f"{picture}.png" for picture in PICTURES)}
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in folder.glob("*.png"))


@pytest.mark.parametrize("name", NAMES)
def test_results_hold_what_is_printed(runs: Runs, name: str) -> None:
    folder, text = runs[name]
    data = json.loads((folder / "results.json").read_text())
    for row in data["modes"]["rows"]:
        assert f"{row['omega']:.6g}" in text and row["residual"] < 1e-10
    for row in data["critical"]:
        assert f"{row['value']:.6g}" in text and f"{row['omega']:.5g}" in text and f"{row['error']:.1e}" in text
    for item in data["complex-modes"]["models"]:
        assert f"{item['growth']:.6g}" in text and (item["model"] == "full" or f"{item['shape_error']:.1e}" in text)
    for row in data["compare"]["rows"]:
        assert f"{row['error_growth']:.1e}" in text and f"{row['error_eigenvalue']:.1e}" in text
    assert data["compare"]["recommended"][0]["sentence"] in " ".join(text.split())
    assert f"{data['compare']['band'][1]:.6g}" in text
    assert f"{data['complex-modes']['least_stable']['backward_error']:.1e}" in text
    # all that a reduced model says agrees with the full one, to what its row claims
    full = data["critical"][0]["value"]
    for row in data["critical"]:
        assert abs(row["value"] / full - 1) == pytest.approx(row["error"], abs=1e-12) and row["error"] < 0.05


@pytest.mark.parametrize("name", NAMES)
def test_vtu_files_hold_the_shapes(runs: Runs, name: str) -> None:
    meshio = pytest.importorskip("meshio")
    folder, _ = runs[name]
    models = Scene.from_file(scene_file(folder.parent, SMALL[name])).models
    mesh, = models.meshes.values()
    found = meshio.read(folder / "modes.vtu")
    normal = fs.normal_modes(models.full, count=14)
    assert np.array_equal(found.cells[0].data, mesh.cells)
    for i in range(3):
        shape = displacements(mesh, models.full.dofs, normal.shapes[:, i])
        shape /= np.linalg.norm(shape, axis=1).max()
        stored = found.point_data[f"mode-{i + 1:02d} {normal.frequencies[i]:.4g} rad/time"]
        assert np.linalg.norm(stored, axis=1).max() == pytest.approx(1.0)
        if name != "solid":  # whose first modes are a pair, of which any combination will do
            assert min(abs(stored - shape).max(), abs(stored + shape).max()) < 1e-6
    held = np.setdiff1d(mesh.numbers, models.full.dofs.nodes) - 1
    assert len(held) and not np.any(found.point_data[next(key for key in found.point_data if key.startswith("mode-01"))][held])
    data = meshio.read(folder / "complex-modes-shape.vtu").point_data
    real, imaginary = (value for key, value in data.items() if "-part " in key)
    assert np.linalg.norm(real, axis=1).max() == pytest.approx(1.0, rel=1e-6)
    assert np.any(imaginary)


@pytest.mark.parametrize("name", NAMES)
def test_a_complex_mode_s_period_is_a_series_of_phases(runs: Runs, name: str) -> None:
    meshio = pytest.importorskip("meshio")
    folder, _ = runs[name]
    row = json.loads((folder / "results.json").read_text())["complex-modes"]["least_stable"]
    data = meshio.read(folder / "complex-modes-shape.vtu").point_data
    named = f"{row['omega']:.4g} rad/time growth {row['eigenvalue'][0]:.4g} 1/time"
    shape = data[f"real-part {named}"] + 1j * data[f"imaginary-part {named}"]
    listed = list(ElementTree.parse(folder / "complex-modes-shape.pvd").iter("DataSet"))
    assert len(listed) == len(list((folder / "complex-modes-shape").iterdir())) == 12
    for item in listed:
        phase = meshio.read(folder / item.attrib["file"])
        turned = (shape * np.exp(1j * row["omega"] * float(item.attrib["timestep"]))).real
        assert np.abs(phase.point_data[f"displacement {named}"] - turned).max() < 1e-9
    assert 12 * float(listed[1].attrib["timestep"]) == pytest.approx(2 * np.pi / row["omega"])


@pytest.mark.parametrize("name", SMALL)
def test_recovered_shapes_fulfil_the_full_pencil_better_with_more_modes(tmp_path: Path, name: str) -> None:
    models = Scene.from_file(scene_file(tmp_path, SMALL[name])).models
    full, acting, band = models.full, models.linear, models.band
    pencil = full.linearised(acting)
    exact = fs.complex_modes(full, acting, band=band, evidence=False)
    at = int(np.argmax(exact.eigenvalues.real))
    errors, angles = [], []
    for modes in (10, 30):
        rom = fs.reduce(full, fs.CraigChang(modes), ports=True)
        found = fs.complex_modes(rom, acting, band=band)
        near = int(np.argmin(abs(found.eigenvalues - exact.eigenvalues[at])))
        u = rom.expand(found.shapes[:, [near]])
        errors.append(pencil.backward_error(found.eigenvalues[[near]], u)[0])
        y = exact.shapes[:, at]
        angles.append(1 - abs(np.vdot(y, u[:, 0])) / np.linalg.norm(y) / np.linalg.norm(u))
        # the error of the eigenvalue is of the order that residual and condition foretell
        assert abs(found.eigenvalues[near] / exact.eigenvalues[at] - 1) < 1e-5
    assert errors[1] < 0.5 * errors[0] < 1e-6 and angles[1] <= angles[0] < 1e-6


@pytest.mark.parametrize(("ask", "there"), [('critical = "slope"', {"critical"}), ("modes = 8", {"modes"})])
def test_only_what_is_asked_is_computed_and_imported(tmp_path: Path, ask: str, there: set[str]) -> None:
    scene = scene_file(tmp_path, asking(SMALL["beam"], ask))
    code = ("import sys; from femsub.app.cli import main; status = main(sys.argv[1:]); "
            "print([name for name in ('meshio', 'matplotlib', 'scipy.io') if name in sys.modules]); sys.exit(status)")
    done = subprocess.run([sys.executable, "-c", code, "run", scene, "--no-figures", "--out", str(tmp_path / "out")],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.splitlines()[-1] == "[]", done.stderr
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results.json", *(f"{name}.csv" for name in there)}
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert set(data) & {"modes", "critical", "complex-modes", "compare", "springs"} == there


def test_modes_solve_no_quadratic_problem_and_reduce_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub.stability import losses

    def never(*_: object, **__: object) -> None:
        raise AssertionError("not asked for")

    for module, name in ((fs, "reduce"), (fs, "complex_modes"), (fs, "study"), (losses, "critical_slope")):
        monkeypatch.setattr(module, name, never)
    told: list[str] = []
    assert "modes" in Scene.from_file(scene_file(tmp_path, asking(SMALL["plate"], "modes = 8"))).run(told.append).data
    assert told == ["plate: building the parts", "plate: modes", "plate: normal modes"]


def test_a_recommendation_is_the_smallest_model_that_keeps_to_the_tolerance() -> None:
    sub = fs.beam(1.0, 40, E=2.1e11, I=1.7e-9, rho=7850, A=2e-4, supports={"left": "clamped"}, interface=["right"],
                  ports={"belt": 0.35}, rayleigh=(5.0, 1e-7))
    methods = [kind(modes) for kind in (fs.CraigBampton, fs.CraigChang) for modes in (4, 8, 16, 24)]
    found = fs.study(sub, methods, band=(0.0, 8500.0), contacts=fs.Belt(slope=-5.0), ports=True, repeats=1)
    for seconds in (1e-3, 1.0, 1e3):  # of one run, whatever the clock told of Craig-Chang
        rows = [replace(row, reduction=Timing.of([seconds])) if row.method == "craig-chang" else row for row in found.rows]
        best = replace(found, rows=with_front(rows, 8500.0)).recommended(1e-3)
        assert best is not None and (best.method, best.modes) == ("craig-chang", 8)
    assert "Craig-Chang with 8 modes (11 DOF)" in found.recommendation(1e-3)
    fit = [row for row in found.rows if row.error_growth <= 1e-3]
    assert len(fit) > 2 and best.size == min(row.size for row in fit)
    few = next(row for row in found.rows if row.modes == 4)
    assert few.cutoff < 8500 and few not in fit
    assert found.recommended(1e-16) is None and "no smaller model" in found.recommendation(1e-16)
    with pytest.raises(ValueError, match="tol must be positive"):
        found.recommended(0)


def test_what_rules_a_model_out() -> None:
    time = Timing(1.0, 1.0, 1.0)
    full = Row("full", 0, 1000, 0.0, 0.0, 0.0, 0, -1.0, 0.0, time, time, 0.0)

    def chosen(**change: float) -> int | None:
        small = Row("craig-chang", 5, 10, 1e-5, 1e-4, 0.0, 0, -1.0, 0.0, time, time, 0.0, cutoff=2.0)
        rows = (replace(small, modes=9, size=20, method="craig-bampton"), replace(small, **change))
        best = Study("x", (0.0, 1.5), 1, full, rows).recommended()
        return best and best.size

    assert chosen() == 10
    for change in ({"error_growth": 2e-3}, {"error_growth": np.nan}, {"missing": 1}, {"extra": 1}, {"cutoff": 1.4}):
        assert chosen(**change) == 20
    complete = Row("craig-chang", 999, 1000, 0.0, 0.0, 0.0, 0, -1.0, 0.0, time, time, 0.0)
    assert Study("x", (0.0, 1.5), 1, full, (complete,)).recommended() is None  # it has as many DOF as the full model


def test_eigenvalues_that_only_the_reduced_model_has_are_counted() -> None:
    sub = fs.chain(10, belt=2)
    full, other = fs.complex_modes(sub, band=(0.0, 0.5)), fs.complex_modes(fs.chain(10, belt=2, springs=0.3))
    assert extra_eigenvalues(full, fs.complex_modes(sub), (0.0, 0.5)) == 0
    inside = int(np.sum((other.eigenvalues.imag >= 0) & (other.eigenvalues.imag <= 0.5)))
    assert extra_eigenvalues(full, other, (0.0, 0.5)) == inside - len(full) > 0


def test_the_band_is_chosen_by_rule(tmp_path: Path) -> None:
    beam = Scene.from_file(scene_file(tmp_path, SMALL["beam"])).models
    omega = fs.normal_modes(beam.full, count=9).frequencies
    assert beam.band == (0.0, pytest.approx(1.02 * omega[7])) and omega[8] > beam.band[1]
    disc = Scene.from_file(scene_file(tmp_path, SMALL["solid"])).models
    omega = fs.normal_modes(disc.full, count=10).frequencies
    assert omega[8] == pytest.approx(omega[7], rel=1e-6)  # 8 and 9 are a pair, which is not split
    assert disc.band == (0.0, pytest.approx(1.02 * omega[8])) and omega[9] > disc.band[1]


def test_a_solid_from_a_mesh_file_beside_the_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("meshio")
    mesh = fs.block((0.2, 0.02, 0.02), (8, 1, 1), "hexahedron20", "bar")
    halves = {"root": np.arange(4), "end": np.arange(4, 8)}
    mesh = fs.Mesh(mesh.points, mesh.cells, mesh.kind, {**mesh.sets, "tip": np.flatnonzero(mesh.points[:, 0] > 0.199)}, halves)
    fs.write_mesh(tmp_path / "bar.vtu", mesh)
    text = ('[material]\nsteel = {E = 2.1e11, rho = 7850.0}\naluminium = {E = 7e10, rho = 2700.0}\n[part.bar]\n'
            'solid = "bar.vtu"\nmaterial = {root = "steel", end = "aluminium"}\nsupports = ["left"]\ninterface = ["right:z"]\n'
            'ports = {belt = ["tip", [0, 0.0, 2]]}\n[contact.belt]\nbelt = "bar.belt"\n[reduce]\nmethods = ["craig-bampton"]\n'
            'modes = [12]\n[[ask]]\ncomplex-modes = "all"\n')
    assert main(["run", scene_file(tmp_path, text), "--no-figures", "--out", str(tmp_path / "out")]) == 0, capsys.readouterr().err
    data = json.loads((tmp_path / "out" / "results.json").read_text())
    assert data["interface"] == 8 and data["complex-modes"]["models"][1]["shape_error"] < 0.1


def tangled(mesh: fs.Mesh) -> fs.Mesh:
    """One cell of a mesh tangled beyond repair: two neighbouring corners exchanged."""
    cells = np.array(mesh.cells)
    cells[0, [0, 1]] = cells[0, [1, 0]]
    return fs.Mesh(mesh.points, cells, mesh.kind, mesh.sets)


STEEL = "[material.steel]\nE = 2.1e11\nrho = 7850.0\n"
FILE = STEEL + """
[part.part]
solid = "mesh.vtu"
material = "steel"
supports = ["left"]
ports = {belt = ["top", "y"]}
rayleigh = [5.0, 1e-7]
[contact.belt]
belt = "part.belt"
force = 8000.0
[reduce]
modes = [4]
repeats = 1
[[ask]]
complex-modes = "all"
"""
OF_BEAM, OF_DISC = 'scene = "beam"\n[part.beam]\n', 'scene = "solid"\n[part.disc]\n'


@pytest.mark.parametrize(("text", "words"), [
    (FILE.replace("left", "lef"), "did you mean 'left'"),
    (FILE.replace('"top", "y"', '"pad", "y"'), "part.part.ports: unknown set 'pad'"),
    (FILE.replace("mesh.vtu", "flat.vtu").replace('supports = ["left"]\n', ""), "a solid needs one of"),
    (FILE.replace("mesh.vtu", "tangled.vtu"), "tangled or flat"),
    (FILE.replace("mesh.vtu", "none.vtu"), "there is no file "),
    (FILE.replace("mesh.vtu", "short.vtu"), "cannot be read as a mesh"),
    (FILE.replace('ports = {belt = ["top", "y"]}\n', ""), "contact.belt.belt: 'part' has no port 'belt'"),
    (FILE.replace('"steel"\nsupports', '{a = "steel"}\nsupports'), "'a'"),
    (OF_DISC + "solid = {radii = [0.1], thickness = 0.01}", "radii: it must be [inner, outer]"),
    (OF_DISC + 'ports = {belt = ["contact", "up"]}', "unknown direction"),
    (FILE.replace("solid =", "thickness = 0.01\nplate =").replace("supports", "clamped").replace('["top", "y"]', '"top"'),
     "triangle or quad cells"),
    ('scene = "plate"\n[part.plate]\nports = {belt = [9.0, 9.0]}', "there is no node at"),
    ('scene = "plate"\n[part.plate]\nthicknes = 1.0', "part.plate.thicknes: unknown key 'thicknes'; did you mean 'thickness'"),
    (OF_BEAM + "beam = -1.0", "line 3: part.beam.beam: it must be positive"),
    (OF_BEAM + 'left = "clamp"', "'clamp'; did you mean 'clamped'"),
    (OF_BEAM + "ports = {belt = 0.3501}", "there is no node at x = 0.3501"),
    (OF_BEAM + "rayleigh = [1.0]", "it must be [alpha, beta]"),
    (OF_BEAM + "width = 0.0", "give width and height, or I and A"),
    ('scene = "beam"\n[reduce]\nmodes = [401]', "401 are more than the 400 DOF"),
    ('scene = "beam"\n[reduce]\nmodes = [-1]', "at least 0"),
    ('scene = "beam"\nband = [2.0, 1.0]', "(lo, hi) with lo < hi, but is (2, 1)"),
    ('scene = "beam"\n[reduce]\ntolerance = 0.0', "reduce.tolerance: it must be positive"),
    ('scene = "beam"\n[contact.belt]\nforce = -1.0', "contact.belt.force: it must not be negative"),
])
def test_bad_input_ends_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str) -> None:
    if ".vtu" in text:
        pytest.importorskip("meshio")
        block = fs.block((1.0, 1.0, 1.0), (2, 2, 1), "hexahedron")
        fs.write_mesh(tmp_path / "mesh.vtu", block)
        fs.write_mesh(tmp_path / "tangled.vtu", tangled(block))
        fs.write_mesh(tmp_path / "flat.vtu", fs.rectangle((1.0, 1.0), (2, 2)).with_sets(top=[0, 1]))
        (tmp_path / "short.vtu").write_bytes((tmp_path / "mesh.vtu").read_bytes()[:300])
    before = {path.name for path in tmp_path.iterdir()} | {"scene.toml"}
    assert main(["run", scene_file(tmp_path, text), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert words in printed.err and printed.err.startswith("femsub: ") and printed.err.count("\n") == 1
    assert printed.out == "" and {path.name for path in tmp_path.iterdir()} == before


def test_displacements_name_what_does_not_fit() -> None:
    sub = fs.beam(1.0, 4, E=1.0, I=1.0, rho=1.0, A=1.0)
    mesh = fs.Mesh(np.linspace(0, 1, 5)[:, None], np.stack([np.arange(4), np.arange(1, 5)], axis=1), "line")
    assert sub.dofs is not None
    assert displacements(mesh, sub.dofs, np.eye(10)[2])[1].tolist() == [0, 0, 1]
    assert displacements(mesh, sub.dofs, 1j * np.eye(10)).shape == (5, 3, 10)
    with pytest.raises(ValueError, match="u must have 10 rows"):
        displacements(mesh, sub.dofs, np.ones(9))
    short = fs.Mesh(mesh.points[:3], mesh.cells[:2], "line")
    with pytest.raises(ValueError, match="has no node 4"):
        displacements(short, sub.dofs, np.ones(10))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plate", "solid"])
def test_cc_wins_on_a_free_interface_and_hcb_on_a_held_one(runs: Runs, name: str) -> None:
    rows = json.loads((runs[name][0] / "results.json").read_text())["springs"]
    most = max(row["modes"] for row in rows)
    error = {(row["model"], row["springs"]): row["error"] for row in rows if row["modes"] == most}
    soft, stiff = min(row["springs"] for row in rows), max(row["springs"] for row in rows)
    assert error["craig-chang", soft] < 0.1 * error["craig-bampton", soft]
    assert error["craig-bampton", stiff] < 0.1 * error["craig-chang", stiff]
    assert max(error.values()) < 0.1


def test_critical_slopes_are_sought_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from femsub.stability import losses

    sought: list[int] = []
    original = losses.critical_slope
    monkeypatch.setattr(losses, "critical_slope", lambda model, *rest, **options: (
        sought.append(model.size), original(model, *rest, **options))[1])
    text = asking(SMALL["beam"], 'critical = "slope"', 'compare = ["growth", "critical"]')
    data = Scene.from_file(scene_file(tmp_path, text)).run(lambda _: None).data
    assert len(sought) == len(data["critical"]) == len(data["compare"]["rows"])
    assert [row["critical"] for row in data["compare"]["rows"]] == [row["value"] for row in data["critical"]]


FREE = asking(FILE.replace("mesh.vtu", "free.vtu").replace('supports = ["left"]\n', "").replace(
    "[reduce]\nmodes = [4]", 'slope = -0.01\n[reduce]\nmethods = ["CC"]\nmodes = [10]'), 'critical = "slope"',
    'compare = ["growth", "critical"]')


@pytest.mark.slow
def test_an_unsupported_solid_drifts_first_and_writes_all_it_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fs.write_mesh(str(tmp_path / "free.vtu"), fs.block((0.1, 0.06, 0.01), (3, 2, 1), "hexahedron20"), {})
    assert main(["run", scene_file(tmp_path, FREE), "-v", "--no-figures", "--out", str(tmp_path / "out")]) == 0
    data, said = json.loads((tmp_path / "out" / "results.json").read_text()), capsys.readouterr().out
    full, rom = data["critical"]
    assert full["omega"] == rom["omega"] == 0.0 and full["value"] < 0 and rom["error"] < 1e-6
    assert "band = [lo, hi] with lo above 0" in said
    assert data["compare"]["rows"][1]["missing"] == 0  # of five equal real eigenvalues, which rounding may make a pair
    rows = {row["model"]: row for row in data["complex-modes"]["models"]}
    assert rows["craig-chang"]["counted"] == rows["full"]["counted"] == rows["full"]["full_counted"]
    # the advice: a band from above zero
    top = data["compare"]["band"][1]
    band = f"band = [{1e-3 * top}, {top}]\n"
    assert main(["run", scene_file(tmp_path, band + FREE), "--no-figures", "--out", str(tmp_path / "other")]) == 0
    rows = json.loads((tmp_path / "other" / "results.json").read_text())["critical"]
    assert all(row["omega"] != 0 and float(row["value"]) < full["value"] and not row["reason"] for row in rows)


def test_a_model_without_a_slope_takes_nothing_from_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = asking(SMALL["beam"].replace("[8, 12]", "[2, 12]"), 'critical = "slope"', 'complex-modes = "all"')
    assert main(["run", scene_file(tmp_path, text), "-v", "--no-figures", "--out", str(tmp_path / "out")]) == 0
    data, said = json.loads((tmp_path / "out" / "results.json").read_text()), capsys.readouterr().out
    slopes = {(row["model"], row["modes"]): row for row in data["critical"]}
    assert slopes["craig-bampton", 2]["value"] is None and "cut-off" in slopes["craig-bampton", 2]["reason"]
    assert slopes["craig-chang", 12]["error"] < 1e-3 and slopes["craig-chang", 12]["reason"] == ""
    assert "reaches above the cut-off" in said
    full = data["complex-modes"]["models"][0]
    few = next(row for row in data["complex-modes"]["models"] if (row["model"], row["modes"]) == ("craig-bampton", 2))
    assert few["up_to"] == few["cutoff"] < full["up_to"] and few["full_counted"] < full["counted"]


def test_the_key_elastic_says_what_is_in_the_band_and_an_ask_what_is_listed(tmp_path: Path) -> None:
    scene = Scene.from_file(scene_file(tmp_path, "elastic = 3\n" + asking(SMALL["beam"], "modes = 3")))
    omega = [row["omega"] for row in scene.run(lambda _: None).data["modes"]["rows"]]
    assert len(omega) == 6 + 3  # as many as a free beam may have; this one has no rigid motion
    assert scene.models.band == pytest.approx((0.0, 1.02 * omega[2]), rel=1e-12)
