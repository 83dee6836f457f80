"""Everything in the README and in the pages of docs/ runs, and the README can be read to its end."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import pytest
import scipy.io

import femsub as fs
from femsub.app.cli import main

ROOT = Path(__file__).parent.parent
#: All pages but those that the site's build makes.
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(
    page for page in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in page.parts
    and (page.name == "index.md" or "reference" not in page.parts) and page.parts[-3:-1] != ("reference", "scenes"))]
TEXTS = {page.relative_to(ROOT).with_suffix("").as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
BLOCKS = [(page, *found) for page, text in TEXTS.items() for found in re.findall(r"```(\w+)\n(.*?)```", text, flags=re.DOTALL)]


LONG = ("docs/guide/motion", "docs/guide/scenes")  # pages whose blocks take more than 3 s


def blocks(language: str) -> list[str]:
    return [text for _, kind, text in BLOCKS if kind == language]


def marked(language: str) -> list[Any]:
    return [pytest.param(text, marks=pytest.mark.slow if page in LONG else ()) for page, kind, text in BLOCKS if kind == language]


def prose(page: str) -> list[str]:
    """The paragraphs of a page and the items of its lists, without code, tables, headings and targets of links."""
    text = re.sub(r"```.*?```", "", TEXTS[page], flags=re.DOTALL)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "CODE", text))
    lines = ["" if line.startswith(("#", "|")) else re.sub(r"^- ", "\n", line) for line in text.splitlines()]
    return [" ".join(part.split()) for part in re.split(r"\n\s*\n", "\n".join(lines)) if part.strip()]


def test_all_kinds_of_blocks_are_known() -> None:
    assert {kind for _, kind, _ in BLOCKS} == {"sh", "python", "toml", "text"}


def test_the_readme_can_be_read_to_its_end() -> None:
    assert len(TEXTS["README"].splitlines()) <= 150
    numbers = re.findall(r"(?<![\w.])\d[\d.,]*\w*", " ".join(prose("README")))
    assert len(numbers) <= 20, numbers


@pytest.mark.parametrize("page", TEXTS)
def test_sentences_are_short(page: str) -> None:
    for paragraph in prose(page):
        for sentence in re.split(r"(?<=[.?!])\**\s", paragraph):
            assert len(sentence.split()) <= 30, sentence


@pytest.mark.parametrize("code", marked("python"))
def test_python(code: str, tmp_path: Path) -> None:
    (tmp_path / "meshes").symlink_to(ROOT / "meshes")
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert all(path.name in code for path in tmp_path.iterdir() if path.name != "meshes")  # only what it names


def test_the_example_prints_what_the_readme_shows() -> None:
    done = subprocess.run([sys.executable, "-c", blocks("python")[0]], capture_output=True, text=True, check=True)
    lines, shown = done.stdout.splitlines(), blocks("text")[0].splitlines()
    assert lines[0].split(";")[0] == shown[0].split(";")[0]  # the backward error is rounding
    assert lines[1] == shown[1]
    for line, other in zip(lines[2:4], shown[2:4], strict=True):
        assert [float(word) for word in line.split()] == pytest.approx([float(word) for word in other.split()], rel=1e-9)
    assert [line.split() for line in lines[4:6]] == [line.split() for line in shown[4:6]]  # columns are as wide as the seconds
    for line, other in zip(lines[7:10], shown[7:10], strict=True):
        found, expected = (text.replace("*", "").split() for text in (line, other))
        assert found[:2] == expected[:2]
        assert [float(error) for error in found[3:6]] == pytest.approx([float(error) for error in expected[3:6]], rel=0.1)


def test_your_own_matrices_lose_their_stability_where_the_full_model_does() -> None:
    code = next(block for block in blocks("python") if "n = 2000" in block)
    names: dict[str, object] = {}
    exec(code, names)
    sub, rom, band = names["sub"], names["rom"], names["band"]
    exact, found = fs.critical_slope(sub, band=band), fs.critical_slope(rom, band=band)
    assert found.slope == pytest.approx(exact.slope, rel=1e-3) and round(found.slope, 4) == -0.0235
    assert found.omega == pytest.approx(exact.omega, rel=1e-6) and round(found.omega) == 316
    with pytest.raises(ValueError, match="cut-off"):
        fs.critical_slope(fs.reduce(sub, fs.CraigChang(modes=20)), band=band)


@pytest.mark.parametrize("text", marked("toml"))
def test_scene_files(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    sub = fs.chain(10)
    for name in "MK":
        scipy.io.mmwrite(tmp_path / f"{name}.mtx", getattr(sub, name).tocoo())
    (tmp_path / "my.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["run", "my.toml", "--out", "out"]) == 0, capsys.readouterr().err
    assert (tmp_path / "out" / "results.json").exists()


def test_commands_exist_and_the_scenes_they_name() -> None:
    for line in "".join(blocks("sh")).splitlines():
        script, *words = line.split()
        assert (ROOT / script).stat().st_mode & 0o111, f"{script} cannot be executed"
        if words[:1] == ["run"]:
            from femsub.app.scene import load

            load(words[1])


def test_files_that_are_named_exist() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"`(scripts/[\w./-]+|\.ci/run|tests/[\w.]+)", text):
            assert (ROOT / name).exists(), name
        for target in re.findall(r"\]\((?!https?:)([^)#]+)", text):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_benchmarks_fit_a_screen_and_each_conclusion_links_to_its_data() -> None:
    page = TEXTS["docs/benchmarks"]
    assert len(page.splitlines()) <= 50
    data = {path.name for path in (ROOT / "benchmarks" / "data").glob("*.txt")}
    assert set(re.findall(r"\(\.\./benchmarks/data/([\w-]+\.txt)\)", page)) == data
    for name in data:
        _, command, seconds = (ROOT / "benchmarks" / "data" / name).read_text(encoding="utf-8").splitlines()[:3]
        assert re.match(r"# (env |python )", command) and re.match(r"# \d+ s, commit ", seconds), name
