"""The map of families in ARCHITECTURE.md: it names every module of the two large folders."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase

import pytest

from tests.folders import TOP

TEXT = (TOP / "ARCHITECTURE.md").read_text(encoding="utf-8")


def table(folder: str) -> list[tuple[str, list[str]]]:
    """The first module and the patterns of each family."""
    part = re.split(r"^##+ ", TEXT.partition(f"### `{folder}`\n")[2], maxsplit=1, flags=re.MULTILINE)[0]
    rows = [line.strip("|").split("|") for line in part.splitlines() if line.startswith("|")][2:]
    return [(first.strip().strip("`"), re.findall("`([^`]+)`", names)) for _, first, names in rows]


@pytest.mark.parametrize("folder", ["integrators", "forces"])
def test_each_module_has_a_family(folder):
    modules = {file.stem for file in (TOP / "src/kickdrift" / folder).glob("[!_]*.py")}
    families = table(folder)
    patterns = [pattern for _, each in families for pattern in each]
    assert not [name for name in modules if not any(fnmatchcase(name, pattern) for pattern in patterns)]
    assert not [pattern for pattern in patterns if not any(fnmatchcase(name, pattern) for name in modules)]
    assert not [first for first, _ in families if first not in modules]
