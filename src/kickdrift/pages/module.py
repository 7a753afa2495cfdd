"""A module of WebAssembly with the step loops of some methods, and the memory that they work on."""

import base64
import zlib
from collections.abc import Callable, Sequence
from inspect import signature
from typing import Any

import numpy as np
from numba import typeof, types

from kickdrift.errors import InputError
from kickdrift.forces.bound.table import SLOTS, measure
from kickdrift.forces.equations.code import PARAMETERS, SIGNATURE, Given, caller
from kickdrift.forces.equations.equation import right_hand_side
from kickdrift.forces.lists.clusters import BUILT
from kickdrift.jit import handle
from kickdrift.jit.compile import FAST_MATH
from kickdrift.jit.handle import Bound
from kickdrift.model.problem import Partial, Problem
from kickdrift.model.system import System
from kickdrift.pages.image import Image
from kickdrift.pages.linking import linked
from kickdrift.pages.lowering import lowered, machine_code

TABLE = "functions"  # exported: addresses of the functions that compiled code calls by address
_FIRST = 2**40  # stands for the first machine code that is on the page alone


class Module:
    """Functions and memory of a page.

    Make the module before the steppers. Their forces are then lowered for the page, and not compiled for this machine,
    so these steppers can take no steps here.
    """

    def __init__(self) -> None:
        self._image = image = Image()
        self._texts: list[Any] = []
        self._glue: list[str] = []
        self._exported: list[str] = []
        self._known: dict[Any, str] = {}  # names of functions
        self._spreads: list[Any] = []  # sqrt(k_B T / m) of the baths of the stepper that is made now
        Bound._compiled = lambda bound, parts: self._bind(bound, parts)  # type: ignore[method-assign, assignment]

        class Callback:
            """Stands for numba's CFunc: a function that compiled code calls by its address on the page."""

            def __init__(made, function: Any, signature: Any, *_: Any) -> None:
                kinds, returned = signature
                silent = returned == types.void
                name = self._function(made, "code", function, kinds, silent, fastmath=FAST_MATH)
                made.address = _FIRST + 2 * len(image.places)
                image.places[made.address] = name

            def compile(made) -> None:
                """Nothing is left to do."""

        handle.CFunc = Callback
        handle._address_for = self._address

    def runs(self, subject: System | Problem, stepper: Any, forces: Any = None) -> dict[str, Any]:
        """What a page needs to run a subject by a stepper at its start: calls of its steps and energy, and y.

        For particles, also their masses, what tells that a list is made, and sqrt(k_B T / m) of heat baths. ``forces``
        are all that act on the particles, for the energy."""
        if isinstance(subject, Problem):
            self._equation(subject)
        if stepper.compiled_steps is None:
            raise InputError("page: this method takes steps in Python, and a page holds compiled steps alone")
        loop, bound, own = stepper.compiled_steps
        y, cursor = stepper.y, np.zeros(SLOTS, np.int64)
        steps = self._call(loop, (bound.table, *own, 0, 1, cursor))
        given = {"steps": steps, "y": [self._image.array(y), *y.shape], "dt": stepper.dt}
        if hasattr(stepper, "compiled_start"):
            loop, bound, own = stepper.compiled_start
            given["first"] = self._call(loop, (bound.table, *own, cursor))
        if isinstance(subject, Problem):
            return {**given, "energy": self._energy(subject, y)}
        places = np.zeros(y.shape[1:]), np.zeros(3), np.zeros(SLOTS, np.int64)
        energy = self._call(measure, (forces.table, 0.0, y, *places))
        lists = [self._image.array(force.pairs.counts[BUILT:]) for force in forces.forces if hasattr(force, "pairs")]
        baths = [(self._image.array(spread), len(spread)) for spread in self._spreads]
        self._spreads.clear()
        return {**given, "energy": energy, "masses": subject.coherent_masses.tolist(), "lists": lists, "baths": baths}

    def written(self) -> dict[str, Any]:
        """The module as plain texts and numbers, for JSON."""
        self._image.settle()
        calls = [f"@{name}" for name in self._known.values()]
        glue = [*self._glue, f"@{TABLE} = constant [{len(calls)} x ptr] [{', '.join(f'ptr {each}' for each in calls)}]"]
        code = machine_code(self._texts, "\n".join(glue), [TABLE, *self._exported])
        wasm = linked(code, [TABLE, *self._exported], len(self._image.bytes))
        names, pieces = list(self._known.values()), self._image.pieces()
        return {
            "wasm": _text(wasm),
            "memory": {
                "pieces": [[place, len(piece)] for place, piece in pieces],
                "data": _text(b"".join(piece for _, piece in pieces)),
            },
            "calls": [[place, names.index(name)] for place, name in self._image.calls],
            "functions": names,
        }

    # -- functions

    def _function(
        self, key: Any, prefix: str, function: Callable[..., Any], kinds: Sequence[Any], silent: bool = False,
        **flags: Any,
    ) -> str:  # fmt: skip
        """Name of a function of the page for arguments of these types. It returns a status, -1 for an exception, or
        nothing if it is ``silent``."""
        if key not in self._known:
            name = self._known[key] = f"{prefix}{len(self._known)}"
            made = lowered(function, kinds, **flags)
            given = ", ".join(f"{kind} %{k}" for k, kind in enumerate(made.kinds))
            self._texts.append(made)
            self._glue += [
                f'declare i32 @"{made.name}"({", ".join(("ptr", "ptr", *made.kinds))})',
                f"define {'void' if silent else 'i64'} @{name}({given}) {{",
                "  %result = alloca i64\n  %error = alloca ptr\n  store i64 0, ptr %result",
                f'  %code = call i32 @"{made.name}"(ptr %result, ptr %error{", " * bool(given)}{given})',
                "  %status = load i64, ptr %result\n  %good = icmp eq i32 %code, 0",
                "  ret void\n}" if silent else "  %found = select i1 %good, i64 %status, i64 -1\n  ret i64 %found\n}",
            ]
        return self._known[key]

    def _address(self, driver: Any, kinds: Sequence[Any]) -> int:
        """Whole number that stands for the address of a driver's own code, which other compiled code calls."""
        key = driver, tuple(kinds), "address"
        if key not in self._known:
            made = lowered(driver.py_func, kinds, fastmath=FAST_MATH)
            self._known[key] = f'"{made.name}"'
            self._texts.append(made)
            self._glue.append(f'declare i32 @"{made.name}"({", ".join(("ptr", "ptr", *made.kinds))})')
        number = _FIRST + 2 * len(self._image.places)
        self._image.places[number] = self._known[key]
        return number

    def _call(self, driver: Any, args: tuple[Any, ...]) -> dict[str, Any]:
        """Call of a driver: the function's name, its arguments, and where each of them begins."""
        kinds = tuple(typeof(each) for each in args)
        name = self._function((driver, kinds), "run", driver.py_func, kinds, fastmath=FAST_MATH)
        if name not in self._exported:
            self._exported.append(name)
        numbers: list[Any] = []
        begins = {}
        for key, value in zip(signature(driver.py_func).parameters, args, strict=True):
            begins[key] = len(numbers)
            numbers += self._image.arguments(value)
        letters = self._kinds(name)
        assert len(letters) == len(numbers), (name, len(letters), len(numbers))
        return {"name": name, "args": numbers, "kinds": letters, "at": begins}

    def _kinds(self, name: str) -> str:
        """A letter for each argument: d for a float64, l for an int64, and i for the rest."""
        at = list(self._known.values()).index(name)
        return "".join({"double": "d", "i64": "l"}.get(kind, "i") for kind in self._texts[at].kinds)

    def _bind(self, bound: Bound, parts: Any) -> Any:
        """The bound force with numbers that stand for addresses on the page."""
        kind = typeof(parts)
        key = type(bound), kind
        compute = None if key in self._known else type(bound)._compute_for(bound, kind)
        name = self._function(key, "force", compute, bound.signature.args, fastmath=FAST_MATH)  # type: ignore[arg-type]
        made = type(bound)(parts)
        made.address, made.work = (_FIRST + 2 * len(self._image.places) + k for k in range(2))
        self._image.places[made.address], self._image.places[made.work] = name, parts
        if hasattr(parts, "bath"):
            self._spreads.append(parts.bath.spread)
        return made

    def _caller(self, problem: Problem, function: Any, outputs: int, prefix: str) -> str:
        """Name of a Problem's f or energy, as a function of t and the addresses of y and of its value."""
        partial = function if isinstance(function, Partial) else Partial(function)
        n = len(problem)
        given = Given(partial.args, PARAMETERS + n)
        memory = np.concatenate([np.zeros(PARAMETERS + n), given.parameters])
        key = (id(problem), prefix)
        if key in self._known:
            return self._known[key]
        made = caller(partial, given, n, outputs, self._image.array(memory))
        return self._function(key, prefix, made, SIGNATURE.args)

    def _equation(self, problem: Problem) -> None:
        if not problem.compiled:
            raise InputError(f"page: {problem.name} has compiled=False; a page holds compiled functions alone")
        name = self._caller(problem, problem.f, len(problem), "f")
        self._image.places[right_hand_side(problem).callback.address] = name

    def _energy(self, problem: Problem, y: Any) -> dict[str, Any] | None:
        if problem.energy is None:
            return None
        name = self._caller(problem, problem.energy, 1, "energy")
        if name not in self._exported:
            self._exported.append(name)
        place = self._image.array(np.zeros(1))
        return {"name": name, "args": [0.0, self._image.array(y), place], "kinds": "dii", "at": {"t": 0, "sums": 2}}


def _text(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 9)).decode("ascii")
