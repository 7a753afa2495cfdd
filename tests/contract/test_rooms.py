"""The layers of ARCHITECTURE.md: imports run one way at every level, deferred imports and imports for types too."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

import kickdrift
from tests.folders import TOP

PACKAGE = Path(kickdrift.__file__).parent
PAGE = TOP / "ARCHITECTURE.md"


def rooms() -> list[str]:
    """Layers in the page's table, from the lowest to the highest."""
    part = PAGE.read_text(encoding="utf-8").partition("## The layers\n")[2].partition("\n## ")[0]
    names = re.findall(r"^\| `(\w+)` \|", part, flags=re.MULTILINE)
    return ["text", "errors", *names]


@cache
def named(text: str) -> set[str]:
    """Modules, or names in them, that a source imports anywhere."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            found |= {f"{node.module}.{name.name}" for name in node.names}
    return found


def imported(text: str) -> set[str]:
    """Modules of kickdrift, or names in them, that a source imports anywhere."""
    return {name for name in named(text) if name.split(".")[0] == "kickdrift"}


@cache
def by_name(text: str) -> set[str]:
    """Names of kickdrift's modules that a source imports as text, up to the first gap for a variable."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.Call):
            continue
        called = getattr(node.func, "attr", getattr(node.func, "id", ""))  # a function of a module, or by its name
        if called in ("import_module", "__import__"):
            given = node.args[0]
            parts = given.values if isinstance(given, ast.JoinedStr) else [given]
            begin = parts[0].value if isinstance(parts[0], ast.Constant) else ""
            found |= {begin} if begin.startswith("kickdrift") else set()
    return found


def module_of(path: str) -> str:
    """Import name of a file of the package."""
    return "kickdrift." + path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def arrows(sources: dict[str, str]) -> dict[str, set[str]]:
    """Modules that each module imports; sources are given by their path in the package."""
    return _arrows(tuple(sources.items()))


@cache
def _arrows(given: tuple[tuple[str, str], ...]) -> dict[str, set[str]]:
    """A name in a module counts as the module. A name with gaps counts as every module that it may mean."""
    sources = dict(given)
    modules = {module_of(path): text for path, text in sources.items()}
    found: dict[str, set[str]] = {}
    for module, text in modules.items():
        named_here = imported(text)
        there = {name if name in modules else name.rpartition(".")[0] for name in named_here}
        there |= {name for begin in by_name(text) for name in modules if name.startswith(begin)}
        found[module] = there & modules.keys() - {module}
    return found


def folders(modules: Iterable[str]) -> set[str]:
    """Packages that hold these modules."""
    return {module.rsplit(".", depth)[0] for module in modules for depth in range(1, module.count(".") + 1)}


def entries(sources: dict[str, str], folder: str) -> dict[str, set[str]]:
    """Entries of a folder, its modules and the folders in it, and the entries that each imports."""
    graph: dict[str, set[str]] = {}

    def entry(module: str) -> str | None:
        if module == folder:
            return "__init__"
        return module.removeprefix(folder + ".").split(".")[0] if module.startswith(folder + ".") else None

    for module, there in arrows(sources).items():
        if (here := entry(module)) is not None:
            graph.setdefault(here, set()).update({name for other in there if (name := entry(other))} - {here})
    return graph


def circles(sources: dict[str, str]) -> list[tuple[str, list[str]]]:
    """Sets of entries that import one another, at each level: the folder, and the entries in alphabetical order."""
    return [
        (folder, circle)
        for folder in sorted(folders(module_of(path) for path in sources))
        for circle in circles_of(entries(sources, folder))
    ]


def circles_of(graph: dict[str, set[str]]) -> list[list[str]]:
    """Sets of nodes that reach one another, each in alphabetical order."""
    left = dict(graph)
    while free := [node for node, there in left.items() if not there & left.keys()]:  # these lead nowhere
        for node in free:
            del left[node]
    reached: dict[str, set[str]] = {}
    for node in left:
        seen, front = set[str](), {node}
        while front:
            front = {name for each in front for name in left[each] & left.keys()} - seen
            seen |= front
        reached[node] = seen
    found = {frozenset(other for other in reached[node] if node in reached[other]) for node in left}
    return sorted(sorted(circle) for circle in found if circle)


def from_test_modules(text: str) -> set[str]:
    """Test modules that a source imports."""
    return {name for name in named(text) if any(part.startswith("test_") for part in name.split("."))}


def backwards(sources: dict[str, str]) -> list[str]:
    """Imports against the order of the layers; sources are given by their path in the package."""
    order = {room: place for place, room in enumerate(rooms())}
    found = []
    for path, text in sources.items():
        here = path.split("/")[0].removesuffix(".py")
        for name in imported(text):
            # the package itself has names of all layers, so that only the highest layer imports it
            there = name.split(".")[1] if "." in name else "cli"
            if there not in order or order[there] > order[here]:
                found.append(f"{path} imports {name}")
    return sorted(found)


def sources() -> dict[str, str]:
    """All sources of the package except those at its top."""
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


def test_only_the_command_line_imports_the_package_itself():
    whole = "def f():\n    import kickdrift as kd\n"
    assert backwards({"cli/main.py": whole}) == []
    assert backwards({"view/page.py": whole}) == ["view/page.py imports kickdrift"]


def test_an_import_the_wrong_way_is_seen():
    top = "from kickdrift.run.simulation import Simulation\n"
    inside = "def f():\n    from kickdrift.cli import main\n"
    typing = "if TYPE_CHECKING:\n    from kickdrift import Simulation\n"
    for text in (top, inside, typing):
        assert len(backwards({"forces/gravity/direct.py": text})) == 1
    assert backwards({"run/plan/plan.py": "from kickdrift.forces.gravity.direct import Gravity\nimport numpy\n"}) == []


def test_no_entries_import_one_another_at_any_level():
    read = sources()
    assert sum(map(len, arrows(read).values())) > 1000
    assert circles(read) == []


@pytest.mark.parametrize("folder", ["kickdrift", "kickdrift.forces", "kickdrift.integrators.splitting"])
def test_an_arrow_back_is_seen_at_each_level(folder):
    read = sources()
    graph = entries(read, folder)
    here, there = next((here, there) for here in sorted(graph) for there in sorted(graph[here]) if "_" not in there)
    inside = folder.replace("kickdrift", "", 1).replace(".", "/").removeprefix("/")
    begin = f"{inside}/{there}".removeprefix("/")
    planted = next(path for path in read if path.removesuffix(".py") == begin or path.startswith(begin + "/"))
    text = f"{read[planted]}\n\ndef planted():\n    from {folder} import {here}\n"
    assert [at for at, circle in circles(read | {planted: text}) if {here, there} <= {*circle}] == [folder]


def test_no_folder_has_more_than_25_modules_and_each_says_what_it_is():
    for folder in {path.parent for path in PACKAGE.rglob("*.py")} - {PACKAGE}:
        assert len([*folder.glob("[!_]*.py")]) <= 25, folder
        assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))), folder


@pytest.mark.parametrize(
    "back",
    [
        "from kickdrift.forces.kernel import bind\n",
        "from kickdrift.forces import kernel\n",
        "import kickdrift.forces.kernel\n",
        "def f():\n    from kickdrift.forces.kernel import bind\n",
        "if TYPE_CHECKING:\n    from kickdrift.forces.kernel import Kernel\n",
        "def f(name):\n    return import_module(f'kickdrift.forces.{name}')\n",
        "def f():\n    return importlib.import_module('kickdrift.forces.kernel')\n",
    ],
)
def test_a_circle_is_seen(back):
    planted = {
        "forces/__init__.py": "from kickdrift.forces.law import Law\n",
        "forces/law.py": "from kickdrift.forces.list import List\nfrom kickdrift.model.box import Box\n",
        "forces/list.py": back,
        "forces/kernel.py": "import numpy\nfrom kickdrift.forces.law import Law\n",
        "model/box.py": "",
    }
    assert circles(planted) == [("kickdrift.forces", ["kernel", "law", "list"])]
    assert circles(planted | {"forces/list.py": "from kickdrift.model import box\n"}) == []


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
    assert done.stdout == "3 kickdrift.elements is deprecated since 0.2; use kickdrift.model.starts.elements\n"
