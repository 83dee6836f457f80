"""The gallery: runs scenes as they are, and makes docs/gallery/index.md of their pictures and run times.

    python -m benchmarks gallery                    the page alone, from the runs that were kept
    python -m benchmarks gallery --run beam plate   runs these first; `--run all`: every scene, one after the other

A run is one process of one thread. docs/gallery/runs.json keeps its processor time, which other work on the machine does not
change much, the commit, and the numbers that its picture shows; docs/pictures/gallery/ has the picture. Three scenes need
files of their own: those in meshes/.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from benchmarks.pictures import commit, shown
from femsub.app.grammar import built_in

SCENES, ROOT = built_in(), Path(__file__).resolve().parents[1]
PAGE, RUNS, PICTURES = ROOT / "docs/gallery/index.md", ROOT / "docs/gallery/runs.json", ROOT / "docs/pictures/gallery"
WIDTH = 1000  # largest width of a picture in pixels


@dataclass(frozen=True)
class Shown:
    """What the gallery shows of a scene: a figure of its run, what is to be seen there, and what the scene teaches."""

    figure: str
    alt: str
    teaches: str
    page: str  #: of the guide
    text: str = ""  #: of the scene file, where the built-in one names files of your own


#: docs/gallery/scenes.toml, in the order of the page.
GALLERY = {name: Shown(**one) for name, one in tomllib.loads(
    (ROOT / "docs/gallery/scenes.toml").read_text(encoding="utf-8")).items()}


def scene_file(scene: str, folder: Path) -> str:
    """The argument of `femsub run`: the scene's name, or a scene file that is written here with the files that it needs."""
    text = GALLERY[scene].text
    if not text:
        return scene
    path = folder / f"{scene}.toml"
    path.write_text(f'scene = "{scene}"\n{text.format(meshes=ROOT / "meshes")}', encoding="utf-8")
    return str(path)


def run_scene(scene: str, out: Path) -> dict[str, Any]:
    """Runs a scene; returns its processor time [s], its memory [MB], the commit, and the numbers that its figure shows."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "femsub", "run", scene_file(scene, Path(folder)), "--quiet", "--out", str(out)]
        process = subprocess.Popen(command, env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)})
        _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"gallery: {scene} failed")
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    return {"seconds": float(f"{used.ru_utime + used.ru_stime:.2g}"), "megabytes": 10 * round(used.ru_maxrss / 1e4),
            "commit": commit(), "shows": shown(results, GALLERY[scene].figure)}


def picture(scene: str, out: Path) -> None:
    """A figure of a run, small enough for a page."""
    from PIL import Image

    with Image.open(out / f"{GALLERY[scene].figure}.png") as drawn:
        image = drawn.convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    PICTURES.mkdir(parents=True, exist_ok=True)
    small = image.quantize(256, Image.Quantize.MEDIANCUT, kmeans=3, dither=Image.Dither.NONE)
    small.save(PICTURES / f"{scene}.png", optimize=True)


def page(runs: dict[str, Any]) -> str:
    """The gallery's page."""
    lines = ["# Gallery", "",
             "Every built-in scene, with no key changed. `scripts/femsub run NAME --out out` repeats a run, and",
             "`scripts/femsub new NAME > my.toml` begins a file of your own with its keys.",
             "Times are processor time of one thread. `matrices`, `own-parts` and `superelements` need files of your own.",
             "Here they take those in `meshes`.", "",
             "[The paper's figures](paper.md) have a page of their own, beside ours.", "",
             "| scene | what it does | run time |", "|---|---|---|",
             *(f"| [{scene}](#{scene}) | {line} | {seconds(runs[scene])} |" for scene, line in SCENES.items())]
    for scene, line in SCENES.items():
        shown = GALLERY[scene]
        lines += ["", f"## {scene}", "", line, "",
                  f"![{shown.alt}](../pictures/gallery/{scene}.png)", "", shown.teaches, "",
                  f"`scripts/femsub new {scene} > my.toml` · {seconds(runs[scene])} · {runs[scene]['megabytes']} MB · "
                  f"[guide](../guide/{shown.page}.md)"]
    return "\n".join(lines) + "\n"


def seconds(found: dict[str, Any]) -> str:
    """'8.2 s', '3 min'."""
    return f"{found['seconds']:.2g} s" if found["seconds"] < 100 else f"{found['seconds'] / 60:.2g} min"


def main(*, run: Annotated[tuple[str, ...], ("all", *SCENES)] = ()) -> None:
    runs = json.loads(RUNS.read_text(encoding="utf-8")) if RUNS.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES if "all" in run else run:
            out = Path(folder) / scene
            runs[scene] = run_scene(scene, out)
            picture(scene, out)
            print(scene, seconds(runs[scene]), flush=True)
            kept = {name: runs[name] for name in SCENES if name in runs}
            lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(one, ensure_ascii=False)}" for name, one in kept.items())
            RUNS.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    PAGE.write_text(page(runs), encoding="utf-8")
