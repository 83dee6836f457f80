"""The command line: `femsub scenes`, `femsub run SCENE [--out DIR]`, `femsub doctor`."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace

from femsub.errors import FemsubError, FemsubWarning, InputError
from femsub.scene import SCENES, load

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
    if options.command == "scenes":
        for name, (_, line) in SCENES.items():
            print(f"{name:<16} {line}")
        return 0
    try:
        if options.command == "doctor":
            return _doctor()
        return _run(options)
    except InputError as error:
        return _fail(error, 2)
    except (TypeError, FemsubError) as error:
        if not isinstance(error, FemsubError):
            raise
        return _fail(error, 2 if isinstance(error, TypeError) else 1)
    except BrokenPipeError:  # `femsub … | head`: the reader has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        return _fail("interrupted; nothing was written", INTERRUPTED)


def _doctor() -> int:
    try:
        from femsub.doctor import report
    except ImportError as error:  # NumPy or SciPy itself
        return _fail(f"{error}; install what femsub needs: scripts/setup, or pip install femsub", 1)
    return report()


def _run(options: argparse.Namespace) -> int:
    scene, run = load(options.scene)
    # Imported late: a scene that is misspelt should not wait for numpy.
    from femsub.report import check_folder, progress, progress_done, write

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
    print(result.text)
    if folder is not None:
        print(f"\nwritten to {folder}: {', '.join(str(path.relative_to(folder)) for path in written)}")
    if not result.data.get("complete", True):
        return _fail("interrupted; the results are what there was by then, marked as incomplete", INTERRUPTED)
    return 0


def _fail(reason: object, status: int) -> int:
    print(f"femsub: {' '.join(str(reason).split())}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
