"""Files and folders that the account may not read or write, and streams that are closed: one line, nothing lost, no traceback.

Root reads everything, so a child process takes another account's rights (`os.seteuid`) where the tests run as root.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DROP = "import os; os.getuid() or os.seteuid(65534)\n"
SUFFIXES = {
    "read_matrix": (".mtx", ".mat", ".npz", ".npy", ".op4", ".pch", ".op2", ".m", ".full", ".txt", ".sub", ".rubbish"),
    "read_component": (".mtx", ".mat", ".npz", ".op4", ".pch", ".asm", ".op2", ".m", ".full", ".sub", ".inp", ".json",
                       ".rubbish"),
    "read_mesh": (".inp", ".bdf", ".dat", ".msh", ".vtu", ".vtk", ".cdb", ".unv", ".uff", ".node", ".ele", ".xdmf", ".su2",
                  ".med"),
    "read_response": (".uff", ".unv", ".npz", ".csv"), "read_modes": (".uff", ".unv", ".rst")}


QUICK = 'figures = false\n[reduce]\nsizes = [3]\nrepeats = 1\n[[ask]]\ncritical = "slope"\n'


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that any account may enter; pytest's own belong to one."""
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        (Path(name) / "home").mkdir()
        (Path(name) / "home").chmod(0o777)
        yield Path(name)


def as_another(code: str, home: Path) -> subprocess.CompletedProcess[str]:
    """Code in a process without the rights of root, with everything imported before."""
    before = ("import femsub as fs, sys\nfor name in fs.__all__: getattr(fs, name)\n"
              "from femsub.app.cli import main\nfrom femsub.app import page, record\n")
    return subprocess.run([sys.executable, "-c", before + DROP + code], capture_output=True, text=True, check=False, cwd="/",
                          env={**os.environ, "HOME": str(home), "NUMBA_CACHE_DIR": str(home), "MPLCONFIGDIR": str(home)})


@pytest.mark.slow
def test_no_reader_meets_a_file_without_rights_unprepared(folder: Path) -> None:
    """Of these, five raised a raw PermissionError. A folder that may not be entered is the same."""
    (folder / "closed").mkdir()
    for suffix in {suffix for suffixes in SUFFIXES.values() for suffix in suffixes}:
        for place in (folder, folder / "closed"):
            (place / f"a{suffix}").write_text("1 2 3\n", encoding="utf-8")
            (place / f"a{suffix}").chmod(0)
    (folder / "closed").chmod(0)
    done = as_another(f"""
for reader, suffixes in {SUFFIXES!r}.items():
    for suffix in suffixes:
        for place in ({str(folder)!r}, {str(folder / "closed")!r}):
            path = f"{{place}}/a{{suffix}}"
            try:
                getattr(fs, reader)(path)
                print("read", reader, path)
            except fs.FemsubError as error:
                if "/a." not in str(error) and "PyAnsys" not in str(error) or "damaged" in str(error):
                    print("words", reader, suffix, error)
            except BaseException as error:
                print("raw", reader, suffix, place[-6:], type(error), error)
""", folder / "home")
    (folder / "closed").chmod(0o755)
    assert done.returncode == 0 and done.stdout == "", done.stdout + done.stderr


@pytest.mark.slow
def test_the_commands_say_in_one_line_what_they_may_not_read_or_write(folder: Path) -> None:
    """A scene, a Python file, results, a page's results, a matrix that a scene names, the folder of --out."""
    scene = f'scene = "chain"\n{QUICK}'
    (folder / "open.toml").write_text(scene, encoding="utf-8")
    (folder / "mine.toml").write_text(scene, encoding="utf-8")
    (folder / "own.py").write_text("", encoding="utf-8")
    (folder / "names.toml").write_text('scene = "matrices"\n[part.part]\nmatrices = {M = "M.mtx", K = "M.mtx"}\n',
                                       encoding="utf-8")
    (folder / "uses.toml").write_text(f'use = ["own.py"]\n{scene}', encoding="utf-8")
    (folder / "M.mtx").write_text("", encoding="utf-8")
    for name in ("results", "closed"):
        (folder / name).mkdir()
        (folder / name / "results.json").write_text("{}", encoding="utf-8")
    for name, mode in (("mine.toml", 0), ("own.py", 0), ("M.mtx", 0), ("results/results.json", 0), ("closed", 0),
                       ("results", 0o777)):
        (folder / name).chmod(mode)
    commands = [["run", "mine.toml"], ["run", "uses.toml"], ["run", "names.toml"], ["run", "results/results.json"],
                ["run", "closed/results.json"], ["run", "closed/a.toml"], ["show", "results"], ["show", "closed"],
                ["run", "open.toml", "--out", "results"], ["run", "open.toml", "--out", "closed"],
                ["run", "open.toml", "--out", "closed/new"], ["run", "open.toml", "--out", "new"], ["audit", "M.mtx"],
                ["audit", "closed/M.mtx"]]
    folder.chmod(0o555)  # a user who is not root owns it
    done = as_another(f"""
os.chdir({str(folder)!r})
for command in {commands!r}:
    print("==", *command, file=sys.stderr, flush=True)
    try:
        print(main(command), file=sys.stderr)
    except BaseException as error:
        print("raw", type(error), error, file=sys.stderr)
""", folder / "home")
    folder.chmod(0o755)
    (folder / "closed").chmod(0o755)
    for part in done.stderr.split("== ")[1:]:
        lines = part.splitlines()
        assert len(lines) == 3 and lines[1].startswith("femsub: ") and lines[2] == "2", part
        assert "ermission" in lines[1] or "audit" in part, part
    assert done.stderr.count("== ") == len(commands), done.stderr


def run(command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHON": sys.executable, **variables})


@pytest.mark.sampled(2)
@pytest.mark.parametrize("closed", ["2>&-", "<&-", ">&-", "<&- >&- 2>&-"])
def test_closed_streams_lose_nothing(closed: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f'scene = "chain"\n{QUICK}', encoding="utf-8")
    done = run(f'cd {tmp_path}; "$PYTHON" -m femsub run a.toml --out out {closed}')
    assert done.returncode == 0 and (tmp_path / "out" / "results.json").is_file(), done.stderr
    assert ("written to out" in done.stdout) == (">&-" not in closed.replace("2>&-", ""))
    assert run(f'cd {tmp_path}; "$PYTHON" -m femsub run nothing.toml {closed}').returncode == 2


@pytest.mark.sampled(4)
@pytest.mark.parametrize("command", ["scenes", "keys chain", "new brake", "run a.toml", "schema"])
def test_a_terminal_without_greek_letters(command: str, tmp_path: Path) -> None:
    """It was a UnicodeEncodeError."""
    (tmp_path / "a.toml").write_text(f'scene = "chain"\n{QUICK}[[ask]]\ncomplex-modes = "all"\n', encoding="utf-8")
    done = run(f'cd {tmp_path}; "$PYTHON" -m femsub {command}', PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and done.stdout.isascii() and len(done.stdout) > 100 and "Traceback" not in done.stderr


def test_ctrl_c_while_the_command_is_imported(tmp_path: Path) -> None:
    """An import that is interrupted ends with one line, by each way the command is started."""
    (tmp_path / "argparse.py").write_text("import os, signal, time\n"
                                         "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
                                         "os.kill(os.getpid(), signal.SIGINT); time.sleep(9)\n",
                                         encoding="utf-8")
    for command in ("-m femsub scenes", '-c "import sys; from femsub.__main__ import main; sys.exit(main())"'):
        done = run(f'"$PYTHON" {command}', PYTHONPATH=f"{tmp_path}:{ROOT}")
        assert done.returncode == 130 and done.stderr == "femsub: interrupted; nothing was written\n", done.stderr
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8") + (ROOT / "scripts" / "femsub").read_text(encoding="utf-8")
    assert 'femsub = "femsub.__main__:main"' in text and "from femsub.__main__ import main" in text
