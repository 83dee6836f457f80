"""What femsub prints where a package is missing, and what the set-up does: the printed command works when it is typed."""

from __future__ import annotations

import ast
import contextlib
import importlib.metadata
import importlib.util
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import femsub as fs
from femsub import checks
from femsub.app import cli
from femsub.checks import EXTRAS, MissingPackageError, installed_by

ROOT = Path(__file__).parent.parent
SOURCES = [path for folder in ("femsub", "scripts", "benchmarks") for path in sorted((ROOT / folder).rglob("*.py"))]


def test_one_place_makes_the_command() -> None:
    """No other module writes one down, and each error takes it from there."""
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        if "pip" not in text and "MissingPackageError" not in text:  # most files: parsing all takes three seconds
            continue
        nodes = list(ast.walk(ast.parse(text)))
        strings = [node.value for node in nodes
                   if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.count("\n") < 2]
        if path.name != "checks.py":
            assert not [one for one in strings if "pip install" in one], path
        for node in nodes:
            if isinstance(node, ast.Raise) and node.exc and "MissingPackageError(" in (raised := ast.unparse(node.exc)):
                assert "installed_by(" in raised or "installation()" in raised or "cannot be imported: {error}" in raised \
                    or "complex scalars" in raised, raised


def test_each_extra_exists_and_brings_its_package() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for package, extra in EXTRAS.items():
        assert not extra or any(re.split("[>=;]", one)[0] == package for one in extras[extra]), (package, extra)


def printed_error(arguments: list[str]) -> None:
    """The command's error as the exception that it was."""
    with contextlib.redirect_stderr(io.StringIO()) as said:
        assert cli.main(arguments) == 1
    raise MissingPackageError(said.getvalue().strip())


def unreadable(folder: Path, name: str) -> Path:
    (folder / name).write_text("$ a mesh\n", encoding="utf-8")
    return folder / name


@pytest.mark.parametrize(("blocked", "packages", "call"), [
    ("meshio", ["meshio"], lambda folder: fs.read_mesh(unreadable(folder, "a.inp"))),
    ("meshio", ["meshio"], lambda folder: fs.read_mesh(unreadable(folder, "a.msh"))),
    ("meshio", ["meshio"], lambda folder: fs.read_mesh(unreadable(folder, "a.bdf"))),
    ("meshio", ["meshio"], lambda folder: fs.write_mesh(folder / "a.vtu", fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"))),
    ("skfem", ["scikit-fem", "meshio"], lambda folder: fs.solid(
        fs.block((1.0, 1.0, 1.0), (1, 1, 1), "hexahedron"), fs.Material(1.0, 0.3, 1.0), interface=["left"])),
    ("pyyeti.nastran.op4", ["pyyeti"], lambda folder: fs.write_matrices(folder / "out", fs.chain(3), "op4")),
    ("shtab", ["shtab"], lambda folder: printed_error(["completion", "bash"]))])
def test_each_reader_says_how_to_install_what_it_lacks(blocked: str, packages: list[str], call: Callable[[Path], object],
                                                       tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, blocked, None)
    with pytest.raises(MissingPackageError) as caught:
        call(tmp_path)
    assert str(caught.value).endswith(": " + installed_by(*packages))


def test_the_command_is_that_of_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    versions = {"numpy": "1.26.4"}
    monkeypatch.setattr(importlib.metadata, "version", lambda name: versions[name])
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "it's mine" / ".venv"))
    monkeypatch.setattr(sys, "executable", "/a b/python")
    assert installed_by("pyyeti") == "'/a b/python' -m pip install \"numpy<2\" pyyeti"
    assert installed_by("numpy", "scipy") == "'/a b/python' -m pip install \"numpy<2\" scipy"
    versions["numpy"] = "2.4.6"
    assert installed_by("pyyeti") == "'/a b/python' -m pip install \"numpy<3\" pyyeti"
    assert installed_by("numpy", numpy_below=2) == "'/a b/python' -m pip install \"numpy<2\""
    setup = tmp_path / "it's mine" / "scripts" / "setup"
    for path, text in ((setup, ""), (setup.parent.parent / ".venv" / ".setup" / "root", f"{setup.parent.parent}\n")):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    typed = "'" + str(setup).replace("'", "'\"'\"'") + "'"
    assert installed_by("pyyeti") == f"{typed} nastran" and installed_by("scikit-fem", "meshio") == f"{typed} fe"
    assert installed_by("numpy", numpy_below=2) == typed and "pip install" in installed_by("gmsh")
    setup.unlink()  # the clone was moved
    assert installed_by("pyyeti").startswith("'/a b/python' -m pip")


def test_a_systems_python_gets_an_environment_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    monkeypatch.setattr(sys, "executable", "/usr/bin/python3")
    monkeypatch.setattr(checks.sysconfig, "get_path", lambda name: str(tmp_path))
    (tmp_path / "EXTERNALLY-MANAGED").touch()
    assert re.fullmatch(r'/usr/bin/python3 -m venv --system-site-packages ~/femsub-venv && '
                        r'~/femsub-venv/bin/python -m pip install "numpy<\d+" meshio', installed_by("meshio"))


@pytest.mark.parametrize("raised", ["ValueError('numpy.dtype size changed, may indicate binary incompatibility')",
                                    "ImportError('numpy.core.multiarray failed to import')"])
def test_an_upgraded_numpy_is_found_by_the_doctor(raised: str, tmp_path: Path) -> None:
    """It was a ValueError of 40 lines at each call."""
    for name in ("petsc4py", "slepc4py"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"def init(*args, **named): raise {raised}\n", encoding="utf-8")
    code = "import sys; from femsub.app.cli import main; sys.exit(main(['doctor']))"
    done = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": f"{tmp_path}:{ROOT}"}, cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    wrong, = [line for line in done.stdout.splitlines() if line.startswith("WRONG")]
    assert done.returncode == 1 and "Traceback" not in done.stdout + done.stderr
    major = int(importlib.metadata.version("numpy").split(".")[0])
    assert "compiled for an earlier NumPy" in wrong
    assert wrong.endswith(f". Install that: {installed_by('numpy', numpy_below=major)}")


def wheel(folder: Path, name: str, version: str, needs: str = "") -> None:
    info = f"{name}-{version}.dist-info"
    with zipfile.ZipFile(folder / f"{name}-{version}-py3-none-any.whl", "w") as file:
        file.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
                      + (f"Requires-Dist: {needs}\n" if needs else ""))
        file.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        file.writestr(f"{info}/RECORD", "")


@pytest.mark.slow
def test_what_is_printed_keeps_numpy_when_it_is_typed(tmp_path: Path) -> None:
    """The newest pyyeti of an index asks for the next NumPy, an earlier one does not."""
    major = int(importlib.metadata.version("numpy").split(".")[0])
    for name, version, needs in (("numpy", f"{major}.99", ""), ("numpy", f"{major + 1}.0", ""),
                                 ("pyyeti", "9.0", f"numpy>={major + 1}"), ("pyyeti", "8.0", f"numpy>={major}")):
        wheel(tmp_path, name, version, needs)
    environment = {**os.environ, "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(tmp_path), "PIP_CONFIG_FILE": os.devnull}
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "venv")], check=True)
    python = str(tmp_path / "venv" / "bin" / "python")
    pip = importlib.util.find_spec("pip")
    assert pip is not None and pip.origin is not None
    purelib = subprocess.run([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], capture_output=True,
                             text=True, check=True).stdout.strip()
    (Path(purelib) / "pip").symlink_to(Path(pip.origin).parent)  # ensurepip takes seconds
    subprocess.run([python, "-m", "pip", "install", f"numpy=={major}.99"], env=environment, check=True, capture_output=True)
    loaded = f"import sys; sys.modules['femsub'] = m = type(sys)('femsub'); " \
             f"m.__path__ = [{str(ROOT / 'femsub')!r}]; from femsub.checks import installed_by; print(installed_by('pyyeti'))"
    printed = subprocess.run([python, "-c", loaded], capture_output=True, text=True, check=True).stdout
    subprocess.run(["bash", "-c", printed], env=environment, check=True, capture_output=True)
    there = subprocess.run([python, "-m", "pip", "freeze"], capture_output=True, text=True, check=True).stdout
    assert f"numpy=={major}.99" in there and "pyyeti==8.0" in there


def test_without_matplotlib_a_run_draws_nothing_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                                            capsys: pytest.CaptureFixture[str]) -> None:
    """The results were lost, after the whole run."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    (tmp_path / "a.toml").write_text('scene = "chain"\n[reduce]\nsizes = [3]\nrepeats = 1\n[[ask]]\nfriction-law = [0.1]\n'
                                     '[[ask]]\n'
                                     'critical = "slope"\n', encoding="utf-8")
    assert cli.main(["run", str(tmp_path / "a.toml"), "--out", str(tmp_path / "out")]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if "matplotlib" in line]
    assert said == [f"femsub: warning: no figures are drawn, they need matplotlib: {installed_by('matplotlib')}"]
    assert (tmp_path / "out" / "results.json").is_file() and not list((tmp_path / "out").glob("*.png"))


@pytest.fixture
def clone() -> Iterator[Path]:
    """The set-up's files in a folder that any account may enter, with stand-ins for pip and petsc4py."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        root = Path(folder) / "clone"
        (root / ".venv" / "bin").mkdir(parents=True)
        (root / ".venv" / "lib" / "python3.11" / "site-packages").mkdir(parents=True)
        (root / "scripts").mkdir()
        for name in ("pyproject.toml", "scripts/setup", "scripts/setup-common.bash", "scripts/femsub"):
            shutil.copy(ROOT / name, root / name)
        python = root / ".venv" / "bin" / "python"
        python.write_text(f"#!/bin/sh\ncase \"$*\" in *tomllib*) exec {sys.executable} \"$@\";; *petsc4py*) echo 1;; esac\n",
                          encoding="utf-8")
        (root / ".venv" / "bin" / "femsub").write_text("#!/bin/sh\necho it runs\n", encoding="utf-8")
        for path in (python, python.with_name("femsub")):
            path.chmod(0o755)
        yield root


def called(command: list[str | Path], **more: Any) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in ("FEMSUB_PYTHON", "PYTHONPATH")}
    options = {"env": environment, "capture_output": True, "text": True, "check": False} | more
    return subprocess.run(list(map(str, command)), **options)


@pytest.mark.parametrize(("extra", "contained"), [
    ("dev", {"figures", "fe", "page", "nastran", "completion", "test", "docs", "dev"}), ("figures", {"figures", "fe"}),
    ("page", {"page"})])
def test_a_set_up_counts_for_the_extras_that_it_contains(extra: str, contained: set[str], clone: Path) -> None:
    common = f"cd {clone}; . scripts/setup-common.bash {extra}; mkdir -p $state; install_femsub"
    done = called(["bash", "-c", common.replace("setup-common.bash ", "setup-common.bash; extra=")])
    assert done.returncode == 0, done.stderr
    state = clone / ".venv" / ".setup"
    assert {path.name for path in state.iterdir()} - {"root", "constraints"} == contained
    assert (clone / ".venv" / "pip.conf").read_text(encoding="utf-8") == f"[install]\nconstraint = {state}/constraints\n"
    if extra != "page":
        assert "it runs" in called([clone / "scripts" / "femsub"]).stdout


@pytest.mark.skipif(os.getuid() != 0, reason="only root can run commands as another account")
def test_a_second_account_uses_a_clone_that_it_may_not_write_or_hears_in_one_line_why_not(clone: Path) -> None:
    def second(*command: str | Path) -> subprocess.CompletedProcess[str]:
        return called(list(command), user="nobody", cwd="/", env={"PATH": os.environ["PATH"], "HOME": "/nonexistent"})

    first = second(clone / "scripts" / "setup", "page")
    assert first.returncode == 1 and first.stderr.count("\n") == 1
    assert f"you may not write in {clone}: its owner, root" in first.stderr
    home = clone.parent / "home"
    home.mkdir()
    shutil.chown(home, "nobody")
    remedy = first.stderr.split("of your own: ")[1]
    done = called(["bash", "-c", remedy], user="nobody", cwd="/", env={"PATH": os.environ["PATH"], "HOME": str(home)})
    assert done.returncode == 0, done.stderr
    assert called([home / "femsub" / "scripts" / "femsub"], user="nobody", cwd="/").stdout == "it runs\n"
    assert called([clone / "scripts" / "setup", "dev"]).returncode == 0
    assert second(clone / "scripts" / "setup", "figures").returncode == 0
    assert second(clone / "scripts" / "femsub").stdout == "it runs\n"
    (clone / "pyproject.toml").write_text((clone / "pyproject.toml").read_text(encoding="utf-8") + "#\n", encoding="utf-8")
    again = second(clone / "scripts" / "femsub")
    assert again.returncode == 1 and again.stderr.count("\n") == 1 and "may not write" in again.stderr and not again.stdout


def test_root_reads_first_that_packages_are_installed_and_dpkg_is_left_alone(clone: Path) -> None:
    tools = clone / "tools"
    tools.mkdir()
    for name, text in (("id", "echo 0"), ("dpkg-query", "echo no"), ("apt-cache", ":"),
                       ("dpkg", f"echo dpkg >>{clone}/called"),
                       ("apt-get", f"echo apt-get >>{clone}/called; echo \"E: run 'dpkg --configure -a'\"; exit 100")):
        (tools / name).write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
        (tools / name).chmod(0o755)
    common = f"cd {clone}; . scripts/setup-common.bash; mkdir -p $state; need_packages '20 s' a-package"
    done = called(["bash", "-c", common], env={**os.environ, "PATH": f"{tools}:{os.environ['PATH']}"})
    lines = [line for line in done.stderr.splitlines() if line.startswith("femsub set-up")]
    assert lines[0] == ("femsub set-up: Debian's a-package are missing on this machine: apt-get installs them as root (20 s)")
    assert done.returncode == 1 and "try: dpkg --configure -a && apt-get update" in lines[-1]
    assert set((clone / "called").read_text().split()) == {"apt-get"}


def test_femsub_without_its_packages_names_the_command() -> None:
    """In an interpreter without site packages, such as Debian's."""
    done = called([sys.executable, "-S", "-c", "import femsub"], env={"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)})
    assert done.returncode and "MissingPackageError: femsub needs numpy, scipy, lazy_loader, threadpoolctl: " in done.stderr
