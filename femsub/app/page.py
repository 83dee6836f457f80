"""The page of a finished run, report.html, from the files of its folder."""

from __future__ import annotations

import io
from contextlib import nullcontext
from pathlib import Path

from femsub.app.report import output_folder, put
from femsub.checks import FemsubError, InputError, unlike, warn
from femsub.io import RESULTS, read_mode, results_of, toml_text
from femsub.output import MODE_FILE, check_plotly, write_page

PAGE_FILE = "report.html"


def show(folder: Path) -> Path:
    """Writes the page of a finished run from the files of its folder, and returns the page's path; nothing is computed.

    Raises
    ------
    InputError
        The folder holds no results of a run, or damaged ones, or a run is writing into it.
    """
    check_plotly()
    with output_folder(str(folder)) if folder.is_dir() else nullcontext():
        path = folder / RESULTS
        data = results_of(path, compared=True)
        if data is None or not data["inputs"]:
            raise InputError(f"{folder} holds no results.json of a run; name the folder that was given by --out")
        place = folder / MODE_FILE
        if place.is_file() and (known := data["sha256"].get(MODE_FILE)) and (why := unlike(place, known)):
            raise InputError(f"{place} is not the file that {RESULTS} was written with: {why}. Delete it, or run the scene again")
        mode = read_mode(place) if place.is_file() else None
        if mode is None and MODE_FILE in data["sha256"]:
            warn(f"{place}, which the run wrote, is gone: the page is made without the mode in motion")
        content = io.BytesIO()
        try:
            write_page(data, toml_text(data["inputs"]), mode, content)
        except FemsubError:
            raise
        except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise InputError(f"{path} is damaged, or not of this version: {type(error).__name__}, {error!s:.100}. Run the scene "
                             "again") from error
        made, = put(folder, {PAGE_FILE: lambda file: file.write(content.getvalue())})
    return made
