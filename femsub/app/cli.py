"""The command line: `femsub scenes`, `femsub new SCENE`, `femsub run SCENE [--out DIR]`, `femsub show DIR`, others: `--help`."""

from __future__ import annotations

import argparse
import io
import json
import logging
import os
import signal
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from femsub import __version__
from femsub.app import audit_command
from femsub.checks import FemsubError, FemsubWarning, InputError, InputTypeError, installed_by, package, printable

if TYPE_CHECKING:
    from femsub.app.grammar import Scene

#: exit statuses as in a shell, 128 + the number of the signal: the reader of the output has ended; Ctrl-C
READER_GONE, INTERRUPTED = 128 + signal.SIGPIPE, 128 + signal.SIGINT
FOLDERS = {"bash": "_shtab_compgen_dirs", "zsh": "_files -/", "tcsh": "d"}  # how shells complete a folder
SCENE_NAME = "a name from `femsub scenes`, or a scene file"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="femsub", description="Reduced substructures for friction-induced vibration: does the stability result survive?")
    parser.add_argument("--version", action="version", version=f"femsub {__version__}",
                        help="print the version (`femsub doctor` names those of PETSc and the other packages)")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("scenes", help="list what can be run")
    shown = commands.add_parser("show", help="make report.html, one page to read, of a finished run; nothing is computed again")
    folder = shown.add_argument("folder", help="the folder that was given by --out")
    folder.complete = FOLDERS  # type: ignore[attr-defined]
    run = commands.add_parser("run", help="run a built-in scene by name, or a scene file")
    _scene_argument(run, "a name from `femsub scenes`, a TOML file, or a results.json: that run again")
    run.add_argument("--trust", metavar="PATH", action="append", default=[],
                     help="allow a Python file with kinds of your own, or a folder from which meshes include files; without "
                     "this option both must lie beside the file that names them")
    _output(run, "write results.json, one CSV file per table and figures there; else nothing is written")
    checked = commands.add_parser("audit", help="check a reduced model from files, by itself or against the full one")
    audit_command.add_arguments(checked)
    _output(checked, "write results.json, CSV files and a figure there")
    explained = commands.add_parser("keys", help="list the kinds of a scene file, or every key of one kind: femsub keys "
                                    "critical")
    explained.add_argument("kind", nargs="?", default="", help="a kind, such as solid, belt or compare; or material, parameter, "
                           "reduce, scene")
    _scene_argument(commands.add_parser("new", help="print the file of a built-in scene, or a file of your own in full: "
                                        "femsub new beam > my.toml"), SCENE_NAME)
    commands.add_parser("schema", help="print the JSON schema of scene files, for editors")
    completion = commands.add_parser("completion", help="print the completion script of a shell: "
                                     "femsub completion bash > ~/.local/share/bash-completion/completions/femsub")
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh"))
    commands.add_parser("doctor", help="what is installed, what it runs on, and what is wrong with it")
    return parser


def _output(command: argparse.ArgumentParser, written: str) -> None:
    """Adds the options for the folder of the results, and for what is printed."""
    out = command.add_argument("--out", metavar="DIR", help=written)
    out.complete = FOLDERS  # type: ignore[attr-defined]
    command.add_argument("--no-figures", action="store_true", help="draw nothing")
    loud = command.add_mutually_exclusive_group()
    loud.add_argument("-q", "--quiet", action="store_true", help="print warnings and errors only")
    loud.add_argument("-v", "--verbose", action="count", default=0,
                      help="print every table, and report on stderr what is factorised, solved and counted; -vv: each "
                      "factorisation and count")


def _scene_argument(command: argparse.ArgumentParser, text: str) -> None:
    scene, function = command.add_argument("scene", help=text), "_femsub_scene_or_file"
    scene.complete = {"bash": function, "zsh": function, "tcsh": "f"}  # type: ignore[attr-defined]


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line. Returns 0 on success, 2 for wrong input, 1 for any other failure; the reason is on stderr.

    `doctor` returns 1 if something is wrong, and `audit` if there is a fault. Ctrl-C returns 130, and a closed pipe 141.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed (2>&-): a file opened later would get its number, and the text printed to it
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal without Greek letters
    options = _parser().parse_args(arguments)
    try:
        if options.command == "run":
            from femsub.app.grammar import Scene

            return _run(options, partial(Scene.from_file, options.scene, options.trust), options.trust)
        if options.command == "audit":
            return _run(options, partial(audit_command.scene, options))
        if options.command == "doctor":
            try:
                from femsub.algebra import examine
            except ImportError as error:  # NumPy or SciPy itself
                return _fail(f"{error}; install what femsub needs: {installed_by('numpy', 'scipy')}", 1)
            found = examine()
            _say(f"femsub       {__version__}, in {Path(__file__).parents[1]}\n{found.text}")
            return bool(found.wrong)
        _say(_printed(options))
        return 0
    except FemsubError as error:
        return _fail(error, 2 if isinstance(error, (InputError, InputTypeError)) else 1)
    except MemoryError as error:
        return _fail(f"not enough memory: {error or 'an allocation failed'}; make the model smaller, or take a larger machine", 1)
    except PermissionError as error:
        return _fail(f"{error.filename} cannot be read or written: {error.strerror}", 2)
    except BrokenPipeError:  # `femsub … | head`: the reader has seen enough
        return READER_GONE
    except KeyboardInterrupt:
        return _fail("interrupted; nothing was written", INTERRUPTED)


def _say(text: str) -> None:
    """Prints to stdout and flushes: at a later flush, a failure could no longer be reported."""
    try:
        print(printable(text), flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes again at its end
        if isinstance(error, BrokenPipeError):
            raise
        raise FemsubError(f"the results could not be printed: {error.strerror}") from None


def _printed(options: argparse.Namespace) -> str:
    """The output of the other commands. Each command imports only the modules that it needs."""
    match options.command:
        case "scenes":
            scenes = _scenes()
            wide = max(map(len, scenes))
            return "\n".join(f"{name:<{wide}}  {line}" for name, line in scenes.items())
        case "keys":
            from femsub.app.explain import keys_text

            return keys_text(options.kind)
        case "new":
            from femsub.app.explain import new_text

            return new_text(options.scene)
        case "show":
            from femsub.app.page import show

            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", FemsubWarning)
                page = show(Path(options.folder))
            _print_warnings(caught)
            return f"written: {page}"
        case "schema":
            from femsub.app.explain import schema

            return json.dumps(schema(), indent=1, ensure_ascii=False)
    shtab = package("shtab", "completion scripts are written by shtab", "shtab")
    names = " ".join(_scenes())
    preamble = {
        "bash": f"""_femsub_scene() {{ compgen -W "{names}" -- "$1"; }}
_femsub_scene_or_file() {{
    _femsub_scene "$1"
    for ending in toml json; do compgen -f -X "!*.$ending" -- "$1"; done
    compgen -d -S / -- "$1"
}}""",
        "zsh": f"""_femsub_scene() {{ compadd {names}; }}
_femsub_scene_or_file() {{ _femsub_scene; _files -g '*.(toml|json)'; }}"""}
    return shtab.complete(_parser(), options.shell, preamble=preamble)


def _scenes() -> dict[str, str]:
    from femsub.app.grammar import built_in

    return built_in()


def printable_record(record: logging.LogRecord) -> bool:
    """A filter of logging: escapes control characters, which a terminal would obey, in a record's text."""
    record.msg, record.args = printable(record.getMessage()), ()
    return True


@contextmanager
def _logged(verbose: int) -> Iterator[None]:
    """Context manager: the library's log goes to stderr, not at all (0), at level INFO (1) or DEBUG (2 and more)."""
    log, handler = logging.getLogger("femsub"), logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("femsub: %(message)s"))
    handler.addFilter(printable_record)
    before = log.level
    if verbose:
        log.addHandler(handler)
        log.setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(before)


def _run(options: argparse.Namespace, loaded: Callable[[], Scene], trusted: Sequence[str] = ()) -> int:
    with warnings.catch_warnings(record=True) as caught, _logged(options.verbose):
        warnings.simplefilter("always", FemsubWarning)
        from femsub.io import including

        with including(*trusted):  # meshes may include files from these folders, too
            scene = loaded()
        # Imported late: a scene that is misspelt should not wait for numpy.
        from femsub.app.record import Record
        from femsub.app.report import output_folder, progress, progress_done
        from femsub.output import fitted

        if options.no_figures:
            scene = scene.without_figures()
        with output_folder(options.out) as folder:
            try:
                loud = logging.getLogger("femsub.app").info if options.verbose else progress
                say = (lambda _: None) if options.quiet else loud
                record = None if folder is None else Record(scene, folder)
                with including(*trusted):
                    result = record.run(say) if record else scene.run(say)
                written = []
                if record is not None:
                    say("writing")
                    written = record.write(result, _texts(caught))
            finally:
                progress_done()
    _print_warnings(caught)
    if not options.quiet:
        _say(fitted(result.printed(scene.units, bool(options.verbose))))
    if folder is not None and not options.quiet:
        below = Counter(path.parent.name for path in written if path.parent != folder)
        names = [path.name for path in written if path.parent == folder] + [f"{name}/ ({n} files)" for name, n in below.items()]
        _say(fitted(f"\nwritten to {folder}: {', '.join(names)}"))
    for output, reason in result.data.get("failed", {}).items():
        _fail(f"{output} failed: {reason}", 1)
    if not result.data.get("complete", True):
        return _fail("interrupted; the results so far are marked as incomplete", INTERRUPTED)
    wrong = options.command == "audit" and result.data["audit"]["verdict"] == "fault"
    return 1 if wrong or "failed" in result.data else 0


def _texts(caught: Sequence[warnings.WarningMessage]) -> list[str]:
    """The texts of the warnings, each once."""
    return list(dict.fromkeys(str(item.message) for item in caught))


def _print_warnings(caught: Sequence[warnings.WarningMessage]) -> None:
    for text in _texts(caught):
        print(f"femsub: warning: {text}", file=sys.stderr)


def _fail(reason: object, status: int) -> int:
    """Prints the reason on stderr, each fault of a file on its own line; returns `status`."""
    for at, line in enumerate(str(reason).splitlines() or [""]):
        print(("  " if at else "femsub: ") + printable(" ".join(line.split())), file=sys.stderr)
    return status

