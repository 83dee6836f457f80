"""What a release says of itself: one version and one date everywhere, no placeholder, and all files in the wheel."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

import femsub as fs
from femsub.app.cli import main

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
CITATION = (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def cited(key: str) -> str:
    """The value of a key of CITATION.cff that stands above all lists."""
    found = re.findall(rf"^{key}: (.+)$", CITATION, re.MULTILINE)
    assert len(found) == 1, (key, found)
    return str(found[0]).strip('"')


def test_all_files_have_one_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    printed = capsys.readouterr().out.split()
    newest = re.findall(r"^## (\S+)", CHANGES, re.MULTILINE)[0]
    assert printed == ["femsub", PROJECT["project"]["version"]]
    assert {PROJECT["project"]["version"], fs.__version__, cited("version"), newest} == {fs.__version__}


def test_the_changelog_has_one_short_entry_for_each_version_of_the_date_that_is_cited() -> None:
    entries = re.findall(r"^## (.*)$", CHANGES, re.MULTILINE)
    assert entries[0] == f"{fs.__version__} ({cited('date-released')})"
    assert all(re.fullmatch(r"\d+\.\d+\.\d+ \(20\d\d-\d\d-\d\d\)", one) for one in entries) and len({*entries}) == len(entries)
    assert all(len(entry.splitlines()) <= 100 for entry in re.split(r"^## ", CHANGES, flags=re.MULTILINE))


def test_citation_and_metadata_agree_and_have_no_placeholder() -> None:
    project = PROJECT["project"]
    assert cited("license") == project["license"] and cited("cff-version") == "1.2.0" and cited("type") == "software"
    assert [one["name"] for one in project["authors"]] == re.findall(r"^  - name: (.+)$", CITATION, re.MULTILINE)
    assert project["description"].split(",")[0].lower() in cited("title").lower()
    for text in (CITATION, str(project)):
        assert not re.search(r"(?i)todo|fixme|xxx|example\.(com|org)|<.*>|0000-0000|\byour\b|10\.\d+/zenodo\.x", text)


def test_every_file_of_the_package_is_in_the_wheel() -> None:
    """By the rules of pyproject.toml; scripts/release looks into the wheel itself."""
    data = PROJECT["tool"]["setuptools"]["package-data"]
    packages = set(PROJECT["tool"]["setuptools"]["packages"])
    listed = shutil.which("git") and subprocess.run(["git", "ls-files", "femsub"], cwd=ROOT, capture_output=True, text=True,
                                                    check=False)
    if not listed or listed.returncode:
        pytest.skip("no repository of git here")
    left = []
    for name in listed.stdout.split():
        path = Path(name)
        package = next(one for one in map(str, path.parents) if one.replace("/", ".") in packages)
        rules = [*data["*"], *data.get(package.replace("/", "."), []), "*.py"]
        if not any(fnmatch(str(path.relative_to(package)), rule) for rule in rules) or (
                path.suffix == ".py" and str(path.parent) != package):
            left.append(name)
    assert listed.stdout and not left
