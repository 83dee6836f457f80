"""Runs the blocks of a page of the documentation, and says where it shows another output than they print.

    scripts/run_page.py docs/guide/flutter.md            compares
    scripts/run_page.py docs/guide/flutter.md --write    writes what is printed into the page, as ```text blocks

Replace by `…` what another run prints otherwise, and cut long numbers in the code: the page's test compares the rest
(benchmarks/pages.py tells how).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.pages import differences, run


def main() -> int:
    parser = argparse.ArgumentParser(description="Runs the blocks of a page, and compares or writes their output.")
    parser.add_argument("page", type=Path)
    parser.add_argument("--write", action="store_true", help="write outputs that differ, or are missing, into the page")
    options = parser.parse_args()
    text, begun = options.page.read_text(encoding="utf-8"), time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        blocks, printed, fault = run(text, Path(folder))
    wrong = False
    for block, output in reversed(list(zip(blocks, printed, strict=False))):
        told = differences(output, block.shown or "")
        if told and options.write:
            start, end = block.shown_at or (block.end, block.end)
            text = text[:start] + (output if block.shown_at else f"\n\n```text\n{output}```") + text[end:]
        elif told:
            wrong = True
            print(f"after\n{block.text}\n{told}\n")
    if options.write:
        options.page.write_text(text, encoding="utf-8")
    print(fault or f"{len(blocks)} blocks, {time.perf_counter() - begun:.1f} s")
    return 1 if wrong or fault else 0


if __name__ == "__main__":
    sys.exit(main())
