"""Edits of the sources of compiled code, in the package and in a user's modules: every such edit causes a compilation,
and no other edit does."""

from __future__ import annotations

import ast
import ctypes
import ctypes.util
import importlib
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from numba import njit, typeof, types, vectorize

import kickdrift as kd
from kickdrift.forces.seam import kernel
from kickdrift.jit.cache import cache as code_cache
from kickdrift.jit.cache import package_files
from kickdrift.jit.cache.described import Description, Sources, fingerprint
from kickdrift.jit.cache.package_files import UnknownSource, imports, reach, sources_hash
from kickdrift.jit.compile import driver, never_inline
from kickdrift.jit.lanes import masks
from kickdrift.jit.lanes.functions import splat

PACKAGE = Path(kd.__file__).parent

# --- the package's own files ---

PLANTED = """
from kickdrift.jit.compile import jit as planted_jit

@planted_jit
def planted(x):
    return 2.0 * x
"""
FILES = {  # text that is added to files in a copy of the package
    "jit/lanes/masks.py": PLANTED,
    "forces/pairs/lanes.py": PLANTED,
    "integrators/wisdom_holman/kepler.py": PLANTED,
    "model/units/quantities.py": "\nPLANTED = 2.0\n",
    "forces/deep/__init__.py": "",
    "forces/deep/er/__init__.py": "",
    "forces/deep/er/code.py": PLANTED,
    "forces/deep/kind.py": """
from typing import NamedTuple
class Kind(NamedTuple):
    k: float
    def law(p, r2):
        return 2.0 * p.k
""",
    "forces/deep/stub.py": "\ndef stub(x): ...\n",
    "forces/deep/far.py": """
from kickdrift.forces.deep.stub import stub
from kickdrift.jit.inner import overload
@overload(stub)
def _stub(x):
    return lambda x: 2.0 * x
""",
    "forces/deep/er/drivers.py": """
from kickdrift.model.units import quantities as units
from kickdrift.forces.pairs import lanes
from kickdrift.forces.deep.er.code import planted
from kickdrift.forces.deep.stub import stub
from kickdrift.integrators.wisdom_holman.kepler import planted as of_kepler
from kickdrift.jit.lanes import masks
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.inner import overload

def law(p): ...

@overload(law)
def _law(p):
    function = jit(p.instance_class.law)
    return lambda p: function(p, 1.0)

@driver
def by_jit(x):
    return masks.planted(x)

@driver
def by_forces(x):
    return lanes.planted(x)

@driver
def by_integrators(x):
    return of_kepler(x)

@driver
def by_constant(x):
    return units.PLANTED * x

@driver
def by_folder(x):
    return planted(x)

@driver
def by_class(p):
    return law(p)

@driver
def by_far(x):
    return stub(x)
""",
}
SCRIPT = """
import sys
from pathlib import Path
import numpy as np
import kickdrift.jit.cache.cache as code_cache
code_cache.folder = lambda: Path(sys.argv[1])
import kickdrift.forces.deep.far
from kickdrift.analysis.observables.pair_counts import pair_counts
from kickdrift.model.box.box import Box
from kickdrift.forces.deep.er import drivers as d
from kickdrift.forces.deep.kind import Kind
counts = pair_counts(np.eye(3)[:2], Box((9.0, 9.0, 9.0)), np.zeros(2, int), False, 2.0, 1)
print(d.by_jit(1.0), d.by_forces(1.0), d.by_integrators(1.0), d.by_constant(1.0), d.by_folder(1.0))
print(d.by_class(Kind(1.0)), d.by_far(1.0), counts[0])
"""
EDITS = [  # file, old, new, index of the number that changes
    ("jit/lanes/masks.py", "2.0 * x", "3.0 * x", 0),
    ("forces/pairs/lanes.py", "2.0 * x", "3.0 * x", 1),
    ("integrators/wisdom_holman/kepler.py", "2.0 * x", "3.0 * x", 2),
    ("model/units/quantities.py", "PLANTED = 2.0", "PLANTED = 3.0", 3),
    ("forces/deep/er/code.py", "2.0 * x", "3.0 * x", 4),
    ("forces/deep/kind.py", "2.0 * p.k", "3.0 * p.k", 5),
    ("forces/deep/far.py", "2.0 * x", "3.0 * x", 6),
    ("analysis/observables/pair_counts.py", "bins - 1)] += 1", "bins - 1)] += 7", 7),
]


class Copy:
    """A copy of the package with its own cache."""

    def __init__(self, path):
        self.path, self.cache = path, path / "cache"
        shutil.copytree(PACKAGE, path / "kickdrift", ignore=shutil.ignore_patterns("__pycache__"))
        for name, text in FILES.items():
            (path / "kickdrift" / name).parent.mkdir(exist_ok=True)
            with open(path / "kickdrift" / name, "a") as file:
                file.write(text)
        (path / "script.py").write_text(SCRIPT)

    def edit(self, name, old, new):
        path = self.path / "kickdrift" / name
        assert path.read_text().count(old) == 1
        path.write_text(path.read_text().replace(old, new))

    def run(self):
        """Output of the script, and names of the functions that it compiled."""
        before = set(self.cache.rglob("*.nbc"))
        environment = os.environ | {"PYTHONPATH": str(self.path)}
        command = [sys.executable, "-B", "script.py", str(self.cache)]
        done = subprocess.run(command, cwd=self.path, env=environment, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr[-3000:]
        made = sorted(path.name.split(".")[-3] for path in set(self.cache.rglob("*.nbc")) - before)
        return [float(word) for word in done.stdout.split()], made


@pytest.mark.long
def test_edits_of_the_package(tmp_path):
    copy = Copy(tmp_path)
    wanted = [2.0] * 7 + [1.0]
    everything = ["by_class", "by_constant", "by_folder", "by_forces", "by_integrators", "by_jit", "count_pairs"]
    assert copy.run() == (wanted, everything)  # by_far may come from another file, so it is not saved
    assert copy.run() == (wanted, [])
    late = "from __future__ import annotations\n"
    for path, line in (
        ("cli/main.py", late),
        ("plots/runs.py", late),
        ("run/simulation.py", late),
        ("forces/gravity/kernel.py", "import numpy as np\n"),
    ):  # from which none of these comes
        copy.edit(path, line, f"{line}\nPLANTED = 1\n")
    assert copy.run() == (wanted, [])
    for name, old, new, k in EDITS:
        copy.edit(name, old, new)
        wanted[k] = 7.0 if k == 7 else 3.0
        found, made = copy.run()
        assert found == wanted, name
        assert bool(made) == (name != "forces/deep/far.py"), name


def modules():
    """Every module of the package, with its file."""
    return {name: Path(file.path) for name, file in package_files._FILES.items()}


def test_every_module_is_known():
    assert set(modules().values()) == set(PACKAGE.rglob("*.py"))
    assert modules()["kickdrift.analysis.observables.pair_counts"] == PACKAGE / "analysis/observables/pair_counts.py"
    assert modules()["kickdrift.forces"] == PACKAGE / "forces" / "__init__.py"


def imported(tree):
    """Imports of the package by Python's own parser, without those for type checkers alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            yield from (each for part in node.orelse for each in imported(part))
        elif isinstance(node, ast.Import):
            yield from ((each.name, "") for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports are not looked for"
            yield from ((node.module, each.name) for each in node.names)
        else:
            yield from imported(node)


def test_imports_are_those_that_python_finds():
    for name, path in modules().items():
        text = path.read_text()
        wanted = {each for each in imported(ast.parse(text)) if package_files.in_package(each[0])}
        assert imports(text) >= wanted, name
        assert {module for module, _ in imports(text)} == {module for module, _ in wanted}, name


def test_code_comes_from_what_a_module_imports():
    def of(name):
        return {each.removeprefix("kickdrift.") for each in reach(frozenset([f"kickdrift.{name}"]))}

    counts, terms = "analysis.observables.pair_counts", "forces.pairs.terms"
    assert of(counts) > {counts, "jit.compile", "jit.inner", "model.box.box"}
    assert of(terms) > {terms, "forces.pairs.binding", "forces.pairs.lanes", "jit.lanes.functions"}
    above = {"cli.main", "plots.runs", "run.simulation", "run.report.report", "trajectory.layout.names"}
    for name in (terms, "integrators.stepping.loops", "integrators.wisdom_holman.loop", "forces.tree.kernel"):
        assert not of(name) & above
        # These import from numba, a user's functions, and layers above by their names; no compiled code calls them.
        for module in of(name) - {"jit.numba_private", "forces.seam.named", "display.showing"}:
            text = modules()[f"kickdrift.{module}"].read_text()
            assert not {"import_module", "__import__"} & set(text.replace("(", " ").split()), module


def test_a_file_that_is_edited_while_the_process_runs(tmp_path, monkeypatch):
    """The process may hold the code from before or after the edit in its memory."""
    path = tmp_path / "module.py"
    path.write_text("x = 1\n")
    entry = package_files._File(str(path), package_files._stamp(os.stat(path)))
    monkeypatch.setitem(package_files._FILES, "kickdrift.planted", entry)
    sources_hash(["kickdrift.planted"])
    path.write_text("x = 22\n")
    with pytest.raises(UnknownSource, match="edited"):
        sources_hash(["kickdrift.planted"])
    path.unlink()
    with pytest.raises(UnknownSource, match="edited"):
        sources_hash(["kickdrift.planted"])
    with pytest.raises(UnknownSource, match="no source"):
        sources_hash(["kickdrift.nowhere"])


# --- a user's modules ---

MINE = """
import enum
import math
from typing import NamedTuple
import numpy as np
from numba import njit
import params
import helpers
import outer.inner
from helpers import direct as renamed
from kickdrift.jit.compile import driver, never_inline

SCALE = 2.0
WEIGHTS = np.arange(30.0)
TABLE = (1.0, (2.0, 3.0))
class Point(NamedTuple):
    a: float
    b: float
POINT = Point(1.0, 2.0)
class Colour(enum.IntEnum):
    RED = 3

def closing(n):
    @njit
    def closed(x, by=2.0):
        return x * n * by
    return closed

closed = closing(4.0)

@njit(error_model="numpy")
def over(x):
    return 1.0 / x

def everything(x):
    of_lambda = lambda y: y * params.BY_LAMBDA
    def nested(y):
        def deeper(z):
            return z + params.NESTED
        return deeper(y) * 2.0
    total = SCALE * x + WEIGHTS[7] + TABLE[1][0] + POINT.a + Colour.RED.value
    total += params.SCALE + outer.inner.DEEP + helpers.asked(x) + renamed(x) + closed(x) + params.ARRAY[1]
    return total + of_lambda(x) + nested(x) + over(x)
"""
OTHERS = {
    "mine.py": MINE,
    "params.py": """
import numpy as np
SCALE = 10.0
BY_LAMBDA = 20.0
NESTED = 30.0
ARRAY = np.array([1.0, 2.0])
UNUSED = object()
""",
    "helpers.py": """
from numba import njit
import third
from numba.extending import overload, register_jitable
def stub(x): ...
@overload(stub)
def _stub(x):
    def body(x):
        return third.OF_OVERLOAD * x
    return body
@register_jitable
def plain(x):
    return x + 0.25
@njit
def asked(x):
    return third.called(x) * 2.0 + stub(x) + plain(x)
@njit
def direct(x):
    return 5.0 * x + third.CONSTANT
""",
    "third.py": """
from numba import njit
CONSTANT = 6.0
OF_OVERLOAD = 9.0
@njit
def called(x):
    return 7.0 * x
""",
    "outer/__init__.py": "",
    "outer/inner.py": "DEEP = 8.0\n",
}
RETURNED = 221.75  # result of everything(2.0)
USES = {  # edits: file, old, new, and the change of the result
    "a global number": ("mine.py", "SCALE = 2.0", "SCALE = 3.0", 2.00),
    "a global array": ("mine.py", "np.arange(30.0)", "np.arange(30.0) * 2.0", 7.00),
    "a tuple in a tuple": ("mine.py", "(2.0, 3.0)", "(4.0, 3.0)", 2.00),
    "a named tuple": ("mine.py", "POINT = Point(1.0", "POINT = Point(5.0", 4.00),
    "a class's constant": ("mine.py", "RED = 3", "RED = 4", 1.00),
    "a closure": ("mine.py", "closing(4.0)", "closing(5.0)", 4.00),
    "a default": ("mine.py", "by=2.0", "by=3.0", 8.00),
    "numba's options": ("mine.py", '@njit(error_model="numpy")', "@njit", 0.00),
    "code in a lambda": ("mine.py", "y * params.BY_LAMBDA", "y - params.BY_LAMBDA", -58.00),
    "code in a nested function": ("mine.py", "z + params.NESTED", "z - params.NESTED", -120.00),
    "a module's attribute": ("params.py", "SCALE = 10.0", "SCALE = 11.0", 1.00),
    "a module's array": ("params.py", "[1.0, 2.0]", "[1.0, 3.0]", 1.00),
    "a global in a lambda": ("params.py", "BY_LAMBDA = 20.0", "BY_LAMBDA = 21.0", 2.00),
    "a global in a nested function": ("params.py", "NESTED = 30.0", "NESTED = 31.0", 2.00),
    "a module in a package": ("outer/inner.py", "DEEP = 8.0", "DEEP = 9.0", 1.00),
    "a function of a module": ("helpers.py", "called(x) * 2.0", "called(x) * 3.0", 14.00),
    "a function that is imported": ("helpers.py", "5.0 * x", "6.0 * x", 2.00),
    "a global of that function": ("third.py", "CONSTANT = 6.0", "CONSTANT = 7.0", 1.00),
    "a function that a function calls": ("third.py", "7.0 * x", "8.0 * x", 4.00),
    "a function for both": ("helpers.py", "x + 0.25", "x + 0.5", 0.25),
    "the body of an overload": ("third.py", "OF_OVERLOAD = 9.0", "OF_OVERLOAD = 10.0", 2.00),
}


@pytest.fixture
def user(tmp_path, monkeypatch):
    """A user's folder of modules: write them, and import them again."""
    names = [name.removesuffix("/__init__.py").removesuffix(".py").replace("/", ".") for name in OTHERS]

    def load(name=None, old="", new=""):
        for path, text in OTHERS.items():
            if path == name:
                assert text.count(old) == 1
                text = text.replace(old, new)
            (tmp_path / path).parent.mkdir(exist_ok=True)
            (tmp_path / path).write_text(text)
        for each in names:
            sys.modules.pop(each, None)
        importlib.invalidate_caches()
        return importlib.import_module("mine")

    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield load
    for each in names:
        sys.modules.pop(each, None)


def described(value):
    return repr(Description().of(value))


@pytest.mark.parametrize("use", USES)
def test_every_edit_of_a_users_code_is_described(user, use):
    first, again = described(user().everything), described(user().everything)
    assert first == again
    assert first != described(user(*USES[use][:3]).everything)


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A separate folder of compiled code."""
    monkeypatch.setattr(code_cache, "folder", lambda: tmp_path / "home")
    monkeypatch.setattr(code_cache, "warm", lambda: ())
    return tmp_path / "home"


def hits(function, *args):
    """Result of a function, compiled, and whether its code came from the disk."""
    made = driver(function)
    return made(*args), bool(sum(made.stats.cache_hits.values()))


@pytest.mark.long
def test_no_stale_code_of_a_user(user, home):
    """Each edit is compiled once, and changes the result."""
    for k, use in enumerate([None, None, *USES, None]):
        *edit, more = USES.get(use, (0.0,))
        found = hits(user(*edit).everything, 2.0)
        assert found == (RETURNED + more, use is None and k > 0), use
    assert len(list(home.rglob("*.nbc"))) == 1 + len(USES)


def test_what_the_code_does_not_use_is_no_edit(user):
    first = described(user().everything)
    assert first == described(user("params.py", "UNUSED = object()", "UNUSED = 5\nMORE = 6").everything)
    assert first == described(user("mine.py", "class Point", "# a remark\nclass Point").everything)


def pair(a, b):
    return namedtuple("Pair", "x y")(a, b)


def returns(value):
    return lambda: value


def typed(function, *signature):
    return njit(*signature)(function)


def add(a, b):
    return a + b


DIFFERENT = {
    "zeros of two signs": (0.0, -0.0),
    "an int and a float": (1, 1.0),
    "an int and a bool": (1, True),
    "text and bytes": ("a", b"a"),
    "text and a number": ("1", 1),
    "nothing and its name": (None, "None"),
    "numpy's and Python's": (np.float64(1.0), 1.0),
    "precisions": (np.float32(1.0), np.float64(1.0)),
    "tuples within": (((1, 2), 3), (1, (2, 3))),
    "a tuple and a list": ((1, 2), [1, 2]),
    "commas": (("a", "b"), ("a', 'b",)),
    "arrays of one memory": (np.zeros(2), np.zeros(2, np.int64)),
    "arrays' shapes": (np.zeros((2, 3)), np.zeros((3, 2))),
    "arrays' orders": (np.zeros((2, 2), order="C"), np.zeros((2, 2), order="F")),
    "arrays' middles": (np.arange(3000.0), np.where(np.arange(3000) == 1500, 7.0, np.arange(3000.0))),
    "records": (np.zeros(1, "f8,i8"), np.zeros(1, "i8,f8")),
    "named tuples": (namedtuple("One", "x y")(1, 2), namedtuple("Two", "x y")(1, 2)),
    "fields": (namedtuple("One", "x y")(1, 2), namedtuple("One", "y x")(1, 2)),
    "closures": (returns(1.0), returns(2.0)),
    "types that a function takes": (typed(add, "float64(float64,float64)"), typed(add, "int64(int64,int64)")),
    "any types and some": (typed(add), typed(add, "int64(int64,int64)")),
    "constants of code": (lambda: 0.0, lambda: -0.0),
    "members of sets": (lambda x: x in {1, 2}, lambda x: x in {1, 3}),
    "builtins": (abs, max),
    "functions of numpy": (np.sin, np.cos),
    "types": (types.float32, types.float64),
}


@pytest.mark.parametrize("what", DIFFERENT)
def test_different_values_are_described_differently(what):
    one, other = DIFFERENT[what]
    assert described(one) == described(one)
    assert described(one) != described(other)


def test_a_description_is_the_same_in_every_process(user, tmp_path):
    wanted = described(user().everything)
    script = "import sys; sys.dont_write_bytecode = True; import mine\n"
    script += "from kickdrift.jit.cache.described import Description\n"
    script += "print(repr(Description().of(mine.everything)))"
    for seed in ("1", "2"):
        environment = os.environ | {"PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", script]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout.strip() == wanted


@vectorize
def vectorized(x):
    return x + 1.0


UNSTABLE = {
    "an object": object(),
    "an object in a tuple": (1.0, object()),
    "an array of objects": np.array([object()]),
    "a function of the machine's": ctypes.CDLL(None).abs if os.name != "nt" else ctypes.cdll.msvcrt.abs,
    "a function over arrays": vectorized,
    "a numba type with parts": types.Tuple([types.float64]),
    "a method": [].append,
}


@pytest.mark.parametrize("what", UNSTABLE)
def test_what_cannot_be_described_is_not_kept(what, home):
    value = UNSTABLE[what]
    with pytest.raises(UnknownSource):
        Description().of(value)
    with pytest.raises(UnknownSource):
        Description().of(lambda: value)


@pytest.mark.skipif(os.name == "nt", reason="needs the C library under a name of its own")
def test_code_that_cannot_be_described_runs(home):
    cosine = ctypes.CDLL(ctypes.util.find_library("m")).cos
    cosine.argtypes, cosine.restype = [ctypes.c_double], ctypes.c_double

    def run(x):
        return cosine(x)

    for _ in range(2):
        assert hits(run, 0.0) == (1.0, False)
    assert not list(home.rglob("*"))


def test_a_global_that_changes_while_compiling(home, monkeypatch):
    """The code may then have either value."""
    load = code_cache.DriverCache.load_overload

    def late(self, sig, context):
        found = load(self, sig, context)
        monkeypatch.setitem(globals(), "_SHIFTING", 2.0)
        return found

    monkeypatch.setattr(code_cache.DriverCache, "load_overload", late)
    assert hits(lambda x: x + _SHIFTING, 1.0) == (3.0, False)
    assert not list(home.rglob("*"))


_SHIFTING = 1.0


def test_classes_of_one_name_in_two_orders():
    """The types have one name in numba, in either order."""

    def made(module, scale):
        cls = namedtuple("Law", "k")
        cls.__module__, cls.law = module, (lambda p, r2: p.k * 2.0) if scale else (lambda p, r2: p.k * 3.0)
        return cls(1.0)

    def key(*values):
        sources = Sources()
        sources.add_type(typeof(values))
        return sources.key("")

    one, two = made("one", True), made("two", False)
    assert str(typeof((one, two))) == str(typeof((two, one)))
    assert key(one, two) == key(one, two) != key(two, one)
    assert fingerprint(type(one)) != fingerprint(type(two))


def test_what_a_users_code_takes_from_the_package_is_in_its_key():
    """The key covers its functions for compiled code, its intrinsics and its overloads, each by its file."""

    def kernel(forces, x, v, a):
        never_inline()
        kd.accelerations(forces, 0.0, x, v, a)
        return masks.select(splat(0.0) > 1.0, splat(1.0), splat(2.0))

    description = Description()
    description.of(kernel)
    wanted = {"jit.compile", "integrators.own.custom", "jit.lanes.masks", "jit.lanes.functions"}
    assert {f"kickdrift.{name}" for name in wanted} <= description.modules


def test_how_a_force_was_registered_is_in_its_key(monkeypatch):
    """The number of rows of its arrays is not part of the force's own code."""
    kind = typeof(namedtuple("Field", "k")(1.0))
    keys = set()
    for rows in (3, 1, 3):
        monkeypatch.setitem(kernel._ROWS, kind.instance_class, rows)
        sources = Sources()
        sources.add_made_around(kernel.compute_for(kind), kind)
        keys.add(sources.key(""))
    assert len(keys) == 2


def test_types_that_are_known_by_an_address_are_not_kept():
    for value in (njit(add), (1.0, njit(add))):
        with pytest.raises(UnknownSource):
            Sources().add_type(typeof(value))
