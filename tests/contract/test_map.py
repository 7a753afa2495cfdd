"""The tables of families in ARCHITECTURE.md: they name every folder inside a layer, with the first line of its text."""

from __future__ import annotations

import ast
import re

from tests.folders import TOP

PACKAGE = TOP / "src/kickdrift"


def tables() -> dict[str, str]:
    """What each folder holds, by its path in the package, from the page."""
    page = (TOP / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Families\n")[2].partition("\n## ")[0]
    parts = re.split(r"^### `(\w+)`$", page, flags=re.MULTILINE)
    return {
        f"{layer}/{folder}": text
        for layer, part in zip(parts[1::2], parts[2::2], strict=True)
        for folder, text in re.findall(r"^\| `([\w/]+)` \| (.+) \|$", part, flags=re.MULTILINE)
    }


def test_the_page_names_each_folder_and_quotes_what_it_is():
    found = {}
    for file in PACKAGE.rglob("__init__.py"):
        folder = file.parent.relative_to(PACKAGE).as_posix()
        if "/" in folder and not folder.startswith("systems"):
            text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            found[folder] = " ".join(text.split("\n\n")[0].split()).removesuffix(".")
    assert len(found) > 40
    assert tables() == found
