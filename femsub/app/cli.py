"""The command line: `femsub scenes`, `femsub run SCENE [--out DIR]`, `femsub doctor`."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace

from femsub.app.scene import SCENES, load
from femsub.errors import FemsubError, FemsubWarning, InputError, InputTypeError

READER_GONE = 141  # the exit status of a command whose output nobody reads any more
INTERRUPTED = 130  # the exit status of what Ctrl-C ends


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="femsub", description="Reduced substructures for friction-induced vibration: does the stability result survive?")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("scenes", help="list what can be run")
    run = commands.add_parser("run", help="run a built-in scene by name, or a scene file")
    run.add_argument("scene", help="a name from `femsub scenes`, or the path of a TOML file")
    run.add_argument("--out", metavar="DIR", help="write results.json, results.csv and figures there; else nothing is written")
    run.add_argument("--no-figures", action="store_true", help="draw nothing")
    commands.add_parser("doctor", help="what is installed, what it runs on, and what is wrong with it")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; 0 if all went well, 2 with one line on stderr where the input was wrong, 1 else.

    `doctor` ends with 1 if something is wrong.
    """
    options = _parser().parse_args(arguments)
    try:
        if options.command == "doctor":
            return _doctor()
        if options.command == "scenes":
            _say("\n".join(f"{name:<16} {line}" for name, (_, line) in SCENES.items()))
            return 0
        return _run(options)
    except FemsubError as error:
        return _fail(error, 2 if isinstance(error, (InputError, InputTypeError)) else 1)
    except MemoryError as error:
        return _fail(f"not enough memory: {error or 'an allocation failed'}; make the model smaller, or take a larger machine", 1)
    except BrokenPipeError:  # `femsub … | head`: the reader has seen enough
        return READER_GONE
    except KeyboardInterrupt:
        return _fail("interrupted; nothing was written", INTERRUPTED)


def _doctor() -> int:
    try:
        from femsub.app.doctor import report
    except ImportError as error:  # NumPy or SciPy itself
        return _fail(f"{error}; install what femsub needs: scripts/setup, or pip install femsub", 1)
    return report()


def _say(text: str) -> None:
    """Prints to stdout, now: what is left in the buffer would fail where nobody can tell of it."""
    try:
        print(text, flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes once more as it ends
        if isinstance(error, BrokenPipeError):
            raise
        raise FemsubError(f"the results could not be printed: {error.strerror}") from None


def _run(options: argparse.Namespace) -> int:
    scene, run = load(options.scene)
    # Imported late: a scene that is misspelt should not wait for numpy.
    from femsub.app.report import check_folder, progress, progress_done, write

    folder = check_folder(options.out)
    if options.no_figures:
        scene = replace(scene, figures=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FemsubWarning)
        try:
            result = run(scene, progress)
            written = []
            if folder is not None:
                progress("writing")
                written = write(result, folder, scene.figures)
        finally:
            progress_done()
    for text in dict.fromkeys(str(item.message) for item in caught):
        print(f"femsub: warning: {text}", file=sys.stderr)
    _say(result.text)
    if folder is not None:
        _say(f"\nwritten to {folder}: {', '.join(str(path.relative_to(folder)) for path in written)}")
    for output, reason in result.data.get("failed", {}).items():
        _fail(f"{output} failed: {reason}", 1)
    if not result.data.get("complete", True):
        return _fail("interrupted; the results are what there was by then, marked as incomplete", INTERRUPTED)
    return 1 if "failed" in result.data else 0


def _fail(reason: object, status: int) -> int:
    print(f"femsub: {' '.join(str(reason).split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
