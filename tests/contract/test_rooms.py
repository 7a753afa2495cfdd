"""The rooms of ARCHITECTURE.md: imports run one way between them, deferred ones and those for types too."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import kickdrift
from tests.folders import TOP

PACKAGE = Path(kickdrift.__file__).parent
PAGE = TOP / "ARCHITECTURE.md"


def rooms() -> list[str]:
    """The page's table, from what knows least to what knows most."""
    names = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return ["text", "errors", *names]


def named(text: str) -> set[str]:
    """The modules, or names in them, that a source imports anywhere."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            found |= {f"{node.module}.{name.name}" for name in node.names}
    return found


def imported(text: str) -> set[str]:
    """The modules of kickdrift, or names in them, that a source imports anywhere."""
    return {name for name in named(text) if name.split(".")[0] == "kickdrift"}


def from_test_modules(text: str) -> set[str]:
    """What a source imports from test modules."""
    return {name for name in named(text) if any(part.startswith("test_") for part in name.split("."))}


def backwards(sources: dict[str, str]) -> list[str]:
    """The imports that run against the order, of sources by their path in the package."""
    order = {room: place for place, room in enumerate(rooms())}
    found = []
    for path, text in sources.items():
        here = path.split("/")[0].removesuffix(".py")
        for name in imported(text):
            there = name.split(".")[1]
            if there not in order or order[there] > order[here]:
                found.append(f"{path} imports {name}")
    return sorted(found)


def sources() -> dict[str, str]:
    """All of the package but what stands at its door."""
    paths = {path.relative_to(PACKAGE).as_posix(): path for path in PACKAGE.rglob("*.py")}
    mine = {name: path for name, path in paths.items() if name.split("/")[0] != "systems"}
    return {name: path.read_text(encoding="utf-8") for name, path in mine.items() if not name.startswith("__")}


def test_every_room_stands_in_the_table_and_every_row_is_a_room():
    there = {path.name for path in PACKAGE.iterdir() if path.is_dir() and not path.name.startswith("_")}
    assert there - {"systems"} == set(rooms()) - {"errors", "text"}
    files = {path.name for path in PACKAGE.glob("*.py")}
    assert files == {"__init__.py", "__main__.py", "errors.py", "text.py"}


def test_no_import_runs_against_the_order():
    read = sources()
    assert len(read) > 200
    assert backwards(read) == []


def test_an_import_the_wrong_way_is_seen():
    top = "from kickdrift.run.simulation import Simulation\n"
    inside = "def f():\n    from kickdrift.cli import main\n"
    typing = "if TYPE_CHECKING:\n    from kickdrift import Simulation\n"
    for text in (top, inside, typing):
        assert len(backwards({"forces/gravity.py": text})) == 1
    assert backwards({"run/plan.py": "from kickdrift.forces.gravity import Gravity\nimport numpy\n"}) == []


def test_no_test_module_imports_another():
    for line in ("from test_x import f", "import tests.unit.test_x", "from tests.unit import test_x as x"):
        assert from_test_modules(f"def g():\n    {line}\n"), line
    for path in (TOP / "tests").rglob("*.py"):
        found = from_test_modules(path.read_text(encoding="utf-8"))
        assert not found, f"{path} imports {found}"


def test_modules_are_found_by_their_old_names_with_a_warning():
    code = "import kickdrift as kd, warnings, sys\nwarnings.simplefilter('always')\n"
    code += "with warnings.catch_warnings(record=True) as told:\n"
    code += (
        "    from kickdrift.elements import elements\n    import kickdrift.units\n    from kickdrift import builders\n"
    )
    code += "from kickdrift.model.starts import elements as new\nassert elements is new.elements\n"
    code += "assert new.__spec__.name == new.__name__ == 'kickdrift.model.starts.elements'\n"
    code += "assert kd.units.quantity and builders.lattice\nprint(len(told), told[0].message)\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "3 kickdrift.elements is kickdrift.model.starts.elements since 0.2\n"
