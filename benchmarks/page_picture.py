"""The picture of a run's page: its verdict, and the least stable mode, as Chromium shows them.

    python -m benchmarks page-picture [--out DIR]

It runs the scene solid with its page, and needs playwright and Chromium.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from benchmarks.pictures import NUMBERS
from femsub.app.cli import main as femsub

NAME = "report.png"
SCENE = 'scene = "solid"\nunits = "SI"\noutputs = ["critical-slope", "error-time", "eigenvalues", "page"]\n'
WIDTH = 1000
ABOVE, BELOW = "#verdict", "#mode .note"  # what the picture begins and ends with


def main(*, out: Path = Path("out/page")) -> None:
    from playwright.sync_api import sync_playwright

    out.mkdir(parents=True, exist_ok=True)
    (out / "scene.toml").write_text(SCENE, encoding="utf-8")
    femsub(["run", str(out / "scene.toml"), "--no-figures", "--out", str(out / "run")])
    with sync_playwright() as play:
        # as root there is no sandbox; without a graphics card WebGL is computed by the processor
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=[
            "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"])
        page = browser.new_context(offline=True, viewport={"width": WIDTH, "height": 1600}).new_page()
        page.set_default_timeout(120_000)
        page.goto((out / "run" / "report.html").resolve().as_uri())
        page.evaluate("window.ready.then(() => null)")
        page.wait_for_timeout(3000)  # the mode is drawn
        top = float(page.locator(ABOVE).evaluate("one => one.getBoundingClientRect().top + window.scrollY")) - 10
        bottom = float(page.locator(BELOW).last.evaluate("one => one.getBoundingClientRect().bottom + window.scrollY")) + 10
        page.screenshot(path=out / NAME, full_page=True, clip={"x": 0, "y": top, "width": WIDTH, "height": bottom - top})
        said = page.locator(ABOVE).first.inner_text().splitlines()
        browser.close()
    (out / NUMBERS).write_text(json.dumps({NAME: [{"says": line} for line in said if line.strip()]}), encoding="utf-8")
