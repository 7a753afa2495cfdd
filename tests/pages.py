"""Run a page of the documentation like a reader who types in everything.

Files with a title are written, lines of ``sh`` that begin with kickdrift are called, with "> FILE" at the end as in a
shell, and blocks of Python run one after the other in one module.

    python -m tests.pages PAGE.md [--apart]

Use an empty folder; Python finds the page's modules there. Blocks without a language are not run. With --apart, each
block of Python has a module of its own, for pages whose blocks a reader copies one by one.
"""

from __future__ import annotations

import re
import shlex
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import NamedTuple
from unittest import mock

BLOCK = re.compile(r'^```(\w+)(?: title="([^"]+)")?\n(.*?)^```', flags=re.DOTALL | re.MULTILINE)


class Block(NamedTuple):
    """A block of code on a page."""

    language: str
    title: str
    code: str


def blocks(page: Path) -> list[Block]:
    """Blocks of a page that name their language, in order."""
    return [Block(*found) for found in BLOCK.findall(page.read_text(encoding="utf-8"))]


def commands(block: Block) -> list[list[str]]:
    """Words of each kickdrift command in an ``sh`` block."""
    lines = [shlex.split(line, comments=True) for line in block.code.splitlines()]
    return [words[1:] for words in lines if words and words[0] == "kickdrift"]


def run(page: Path, apart: bool = False) -> dict[str, object]:
    """Run a page in the current folder and return the names that its Python defines, or that its last block defines."""
    own = {"__name__": page.stem.replace("-", "_")}
    names: dict[str, object] = dict(own)
    for block in blocks(page):
        if block.title:
            Path(block.title).write_text(block.code, encoding="utf-8")
        elif block.language == "python":
            names = dict(own) if apart else names
            exec(compile(block.code, str(page), "exec"), names)
        elif block.language == "sh":
            for words in commands(block):
                status = exit_status(words)
                if status:
                    raise SystemExit(f"{page.name}: kickdrift {' '.join(words)} ended with {status}")
    return names


def exit_status(words: list[str]) -> int:
    """Exit status of kickdrift with these arguments."""
    from kickdrift.cli.main import main

    if ">" in words:
        *words, _, name = words
        with open(name, "w", encoding="utf-8") as file, redirect_stdout(file):
            return exit_status(words)
    with mock.patch.object(sys, "argv", ["kickdrift", *words]):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0


if __name__ == "__main__":
    run(Path(sys.argv[1]), apart="--apart" in sys.argv[2:])
