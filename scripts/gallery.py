"""The gallery: runs scenes as they are, and makes docs/gallery/index.md of their pictures and run times.

    python scripts/gallery.py                    the page alone, from the runs that were kept
    python scripts/gallery.py --run beam plate   runs these first; `--run all`: every scene, one after the other

A run is one process of one thread. docs/gallery/runs.json keeps its processor time, which other work on the machine does not
change much, the commit, and the numbers that its picture shows; docs/pictures/gallery/ has the picture. Three scenes need
files of their own: those in meshes/.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.pictures import commit, shown
from femsub.app.scene import SCENES

ROOT = Path(__file__).resolve().parents[1]
PAGE, RUNS, PICTURES = ROOT / "docs/gallery/index.md", ROOT / "docs/gallery/runs.json", ROOT / "docs/pictures/gallery"
WIDTH = 1000  # pixels of a picture, at most


@dataclass(frozen=True)
class Shown:
    """What the gallery shows of a scene: a figure of its run, what is to be seen there, and what the scene teaches."""

    figure: str
    alt: str
    teaches: str
    page: str  #: of the guide
    text: str = ""  #: of the scene file, where the scene has no defaults to run with


BEAM = '''M = "{meshes}/calculix/beam.mas"
K = "{meshes}/calculix/beam.sti"
dofs = "{meshes}/calculix/beam.dof"
interface = ["17:*", "18:*", "19:*", "20:*"]
'''
SUPERELEMENTS = """band = [0.0, 60.0]
reference = [10.67387655, 11.10545089, 11.67240184, 21.48605746]

[[parts]]
name = "in"
file = "{meshes}/nastran/inboard.asm"
cutoff = 314.0

[[parts]]
name = "out"
file = "{meshes}/nastran/outboard.asm"
cutoff = 314.0

[[joints]]
between = ["in", "out"]
"""
GALLERY = {
    "chain": Shown(
        "size-sweep", "Critical slope of the chain and its relative error, over the DOF of the reduced model",
        "Four coordinates of ten give the border of stability to 1e-6 with Craig-Chang, and to 0.6 % with Craig-Bampton. With "
        "the belt's mass in the interface, Craig-Bampton comes to 3e-6.", "scenes"),
    "matrices": Shown(
        "eigenvalues", "Eigenvalues of full and reduced models in the complex plane, for 4, 8 and 16 modes",
        "Matrices that CalculiX wrote of a clamped beam, 144 DOF, become models of 16 to 28 DOF. With four modes the uppermost "
        "eigenvalue is wrong, and the cut-off of Craig-Chang says so.", "matrices",
        f"{BEAM}port = [\"17:uy\"]\nmodes = [4, 8, 16]\nband = [0.0, 2e4]\nslope = -0.3\n"),
    "beam": Shown(
        "modes", "The first six bending modes of a clamped beam, with contact and interface marked",
        "The beam's modes come with the places of the belt (triangle) and of the interface (square). The belt hardly touches "
        "mode 4, which has a node there.", "components"),
    "plate": Shown(
        "least-stable", "Real and imaginary part of the plate's least stable mode",
        "The mode that grows is shown on all 3,200 DOF, although a model of 39 was solved. Friction makes it complex: a little "
        "torsion joins the bending, a quarter of a period later.", "components"),
    "solid": Shown(
        "least-stable", "The least stable mode of a disc in three dimensions, real and imaginary part",
        "A brake's disc of 7,920 DOF, and the mode of three nodal diameters that friction drives. Craig-Chang with 20 DOF gives "
        "its critical slope to 1.3e-6.", "components"),
    "frequency-response": Shown(
        "frequency-response", "Magnitude and phase of a beam's receptance over frequency, and the bound of each model's error",
        "A beam with a loss factor of 1 % answers to a force at its contact. Craig-Chang with 11 of 400 DOF follows it to 2.4e-5 "
        "of the largest response.", "frequency-response"),
    "chain-parts": Shown(
        "methods-2-parts", "Errors over run time of two joined halves of the chain, by five methods",
        "Two halves of the chain are reduced by themselves, with five methods, and joined again. At nine DOF the growth rates "
        "are off by 0.03 % with Craig-Bampton and by 1.8 % with Guyan.", "coupling"),
    "plate-parts": Shown(
        "parts", "A plate cut into eight parts",
        "A plate of 1,824 DOF is cut into eight parts, and each gets as many modes as it needs: three to five. Of the 344 "
        "coordinates that remain, 312 belong to interfaces: these decide the size.", "coupling"),
    "solid-parts": Shown(
        "parts", "Eight solids, joined and drawn apart: base, posts, cover, carrier and pad",
        "Glue joins meshes that do not match, bolts are springs. Only the cover needs modes, 29 of them: for the seven "
        "other parts, constraint modes are enough.", "coupling"),
    "own-parts": Shown(
        "methods", "Errors over run time of two beams joined by springs, by five methods",
        "Two beams, whose matrices CalculiX wrote, are joined by springs at their ends. With 40 of 288 DOF Craig-Chang keeps the "
        "frequencies within 1e-5, Craig-Bampton within 5e-3.", "coupling",
        f"""band = [0.0, 2e4]
slope = -0.3
modes = [2, 4, 8]

[[parts]]
name = "left"
{BEAM}port = ["17:uy"]

[[parts]]
name = "right"
{BEAM}
[[joints]]
kind = "spring"
between = ["left", "right"]
stiffness = 1e6
damping = 10.0
"""),
    "superelements": Shown(
        "methods", "Errors over run time of two superelements of Nastran, joined and reduced once more by three methods",
        "Two parts that Nastran reduced are joined, with its frequencies to seven digits, and reduced once more. With 44 of 54 "
        "DOF Craig-Bampton keeps the frequencies within 1.1e-4.", "superelements", SUPERELEMENTS),
    "brake": Shown(
        "flutter", "Frequencies and growth rates of a brake over the coefficient of friction",
        "Two modes of a disc brake meet over the coefficient of friction, and one of them squeals. A model of 190 DOF follows "
        "the full one of 7,458.", "friction"),
    "chain-transient": Shown(
        "spectrogram", "Spectra over time of the full chain and of two reduced models",
        "All three models lose stability at the same slope, but they do not move alike beyond it. The full chain ends at ω = "
        "0.15, 1.64 and 1.79, the reduced ones at 0.72: they lack four of the eight growing modes.", "motion"),
    "solid-transient": Shown(
        "error-time", "Error of the amplitude over the run time of a period, full and reduced",
        "A disc of 1,512 DOF moves on its limit cycle. With 50 DOF a simulated period costs some 70 times less, and the "
        "amplitude is right to 0.4 %.", "motion"),
    "chain-limit-cycle": Shown(
        "bifurcation", "Amplitude and frequency of four families of limit cycles over the slope of the friction law",
        "Each mode that loses its stability starts a family of limit cycles at a Hopf point. The reduced models follow the first "
        "family closely, but in the fourth they are stable where the full chain is not.", "motion"),
    "plate-limit-cycle": Shown(
        "bifurcation", "Amplitude and frequency of the plate's limit cycles over the normal force",
        "Limit cycles of a plate of 3,200 DOF begin at a subcritical Hopf point, turn at a fold and grow with the force. Models "
        "of 29 DOF follow the full one (crosses) to 4e-5 in amplitude.", "motion"),
    "two-mode": Shown(
        "flutter-diagram", "Frequencies and growth rates of two modes over the coefficient of friction",
        "Friction brings two frequencies together until they merge, and one mode begins to grow: flutter at μ = 0.75. With "
        "damping it is μ = 0.7575, both to all digits of the closed form.", "stability-maps"),
    "affine": Shown(
        "flutter-diagram", "Frequencies and growth rates over the speed of rotation",
        "Matrices with factors, such as μ/Ω and Ω², make a model over the speed. Between 0.041 and 0.116 one mode grows, and the "
        "scene finds both ends of this range.", "flutter"),
    "ziegler": Shown(
        "flutter-diagram", "Frequencies and growth rates of Ziegler's pendulum over the load, for three dampings",
        "A little damping destabilises: b = 0.01 lowers the critical load from 2.09 to 1.46. That is Ziegler's paradox, found "
        "here without and with damping.", "stability-maps"),
    "audit": Shown(
        "frequencies", "Errors of the frequencies of a reduced beam, small below the mode that is missing and large above",
        "From a beam's model of twelve coordinates one mode is missing, and its matrices look well. The count of the full "
        "model's modes tells it, and up to where the frequencies may be trusted all the same.", "audit"),
}


def scene_file(scene: str, folder: Path) -> str:
    """What `femsub run` takes: the scene's name, or a file that is written here with what it needs."""
    text = GALLERY[scene].text
    if not text:
        return scene
    path = folder / f"{scene}.toml"
    path.write_text(f'scene = "{scene}"\n{text.format(meshes=ROOT / "meshes")}', encoding="utf-8")
    return str(path)


def run(scene: str, out: Path) -> dict[str, Any]:
    """Runs a scene, and gives its processor time [s], its memory [MB], the commit, and what its figure shows."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "femsub", "run", scene_file(scene, Path(folder)), "--quiet", "--out", str(out)]
        process = subprocess.Popen(command, env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)})
        _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"scripts/gallery.py: {scene} failed")
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    return told(used) | {"commit": commit(), "shows": shown(results, GALLERY[scene].figure)}


def told(used: resource.struct_rusage) -> dict[str, Any]:
    return {"seconds": float(f"{used.ru_utime + used.ru_stime:.2g}"), "megabytes": 10 * round(used.ru_maxrss / 1e4)}


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
             "Every scene as it stands, without a key changed. `scripts/femsub run NAME --out out` repeats a run, and",
             "`scripts/femsub new NAME > my.toml` begins a file of your own with its keys.",
             "Times are processor time of one thread. `matrices`, `own-parts` and `superelements` need files of your own.",
             "Here they take those in `meshes`.", "",
             "[The paper's figures](paper.md) stand on a page of their own, beside ours.", "",
             "| scene | what it does | run time |", "|---|---|---|",
             *(f"| [{scene}](#{scene}) | {line} | {seconds(runs[scene])} |" for scene, (_, line) in SCENES.items())]
    for scene, (_, line) in SCENES.items():
        shown = GALLERY[scene]
        lines += ["", f"## {scene}", "", f"{line[0].upper()}{line[1:]}.", "",
                  f"![{shown.alt}](../pictures/gallery/{scene}.png)", "", shown.teaches, "",
                  f"`scripts/femsub new {scene} > my.toml` · {seconds(runs[scene])} · {runs[scene]['megabytes']} MB · "
                  f"[guide](../guide/{shown.page}.md)"]
    return "\n".join(lines) + "\n"


def seconds(found: dict[str, Any]) -> str:
    """'8.2 s', '3 min'."""
    return f"{found['seconds']:.2g} s" if found["seconds"] < 100 else f"{found['seconds'] / 60:.2g} min"


def main() -> None:
    parser = argparse.ArgumentParser(description="Makes the gallery of scenes.")
    parser.add_argument("--run", nargs="+", default=[], metavar="SCENE", choices=["all", *SCENES], help="scenes to run first")
    parser.add_argument("--work", type=Path, help="keep the runs' folders there")
    options = parser.parse_args()
    runs = json.loads(RUNS.read_text(encoding="utf-8")) if RUNS.exists() else {}
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES if "all" in options.run else options.run:
            out = (options.work or Path(folder)) / scene
            runs[scene] = run(scene, out)
            picture(scene, out)
            print(scene, seconds(runs[scene]), flush=True)
            kept = {name: runs[name] for name in SCENES if name in runs}
            lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(one, ensure_ascii=False)}" for name, one in kept.items())
            RUNS.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    PAGE.write_text(page(runs), encoding="utf-8")


if __name__ == "__main__":
    main()
