"""`Beside`: the user's own equations for unknowns beside the bodies. Importing this module compiles nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.beside.columns import COLUMNS, Bodies, Columns
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.laws.law import raised_at
from kickdrift.forces.seam.arguments import number
from kickdrift.forces.seam.named import found, is_function, named
from kickdrift.model.checks.arguments import checked_arguments, misfit
from kickdrift.model.checks.values import is_number, positive
from kickdrift.model.state import Floats
from kickdrift.text import clean, shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

UNKNOWNS = "unknowns"  # field of a State
MOST = 1000  # unknowns; each is a column of y
LATER = 0.37  # time of a trial, to see whether a function depends on time


@checked_arguments
@dataclass(frozen=True)
class Beside(Field):
    """Unknowns beside the bodies: equations y' = f(t, y, bodies), and what y does to the bodies.

    ``f(t, y, bodies)`` returns the k rates. ``acts(t, y, bodies, a)`` adds accelerations to ``a`` (3, n), and returns
    their potential energy, or None. ``bodies`` has positions ``x`` and velocities ``v``, (3, n), and masses ``m``
    (n,), in the system's units. Both functions are compiled by numba, so they may use loops, ``if``, NumPy and
    ``math``, and they must keep no state between calls.

    Adaptive methods, Runge-Kutta and implicit methods take bodies and unknowns as one system, with one error control.
    Splitting words whose order is 2, or which are rows of leapfrog steps, advance the unknowns by the classical
    Runge-Kutta method of order 4 while the bodies rest: in the middle of each drift, or around each kick of a word that
    begins with a drift. ``wisdom-holman`` and ``saba`` do so around each kick, and keep order 2.

    ``state.unknowns`` has y. Each unknown is a column of a run's file and of its samples, under its name. A `Crossing`
    of such a system takes a function (t, x, v, y). The energy that the unknowns have is not in the total energy.

    A run's file stores the import paths of the functions. ``kd.resume`` finds them again if the program has made a
    `Beside` of them; a function inside another function has no path: give ``kd.resume`` the system.

    Parameters
    ----------
    f : the rates, or the import path of a function that this program has named
    y0 : k numbers, the unknowns at the start
    names : k names; default y0, y1, …
    acts : what the unknowns do to the bodies; default nothing
    atol : absolute tolerance of the unknowns, one number or k; default the run's. ``gauss-radau15`` has none
    velocity_dependent : whether ``acts`` depends on the bodies' velocities; splitting methods need that it does not

    Raises
    ------
    InputError
        For names that are bodies of the system or not different, and when a System is made, for a function that
        raises or returns anything else at the start.
    """

    f: Any
    y0: Any
    names: Any = ()
    acts: Any = None
    atol: Any = None
    velocity_dependent: bool = False

    name: ClassVar[str] = "beside"
    dimensions: ClassVar[dict[str, str]] = {}
    time_dependent: ClassVar[bool] = True
    joins: ClassVar[bool] = True
    sign: ClassVar[float] = 1.0  # -1 for the motion back in time

    def __post_init__(self) -> None:
        put = object.__setattr__
        for key, arguments in (("f", 3), ("acts", 4)):
            given = getattr(self, key)
            if given is None and key == "acts":
                continue
            if isinstance(given, str):
                put(self, key, found(f"{self.name}: {key}", given, is_function))
            if not is_function(getattr(self, key)):
                raise InputError(f"{self.name}: {key}: expected a function, got {shown(given)}")
            if signature := misfit(getattr(getattr(self, key), "py_func", getattr(self, key)), *[None] * arguments):
                takes = ("t", "y", "bodies", "a")[:arguments]
                raise InputError(f"{self.name}: {key} must take ({', '.join(takes)}), not {signature}")
            named(getattr(self, key))
        values = [number(self.name, f"y0[{k}]", each) for k, each in enumerate(_listed("y0", self.y0))]
        if not 0 < len(values) <= MOST:
            raise InputError(f"{self.name}: y0: expected 1 to {MOST} numbers, got {len(values)}")
        put(self, "y0", tuple(values))
        names = _listed("names", self.names) or [f"y{k}" for k in range(len(values))]
        if len(names) != len(values):
            raise InputError(f"{self.name}: names: expected {len(values)}, one for each number of y0, got {len(names)}")
        for each in names:
            if not (isinstance(each, str) and each.isidentifier()):
                raise InputError(f"{self.name}: names: expected words such as theta or y_1, got {shown(each)}")
            if names.count(each) > 1:
                raise InputError(f"{self.name}: names: {clean(each)!r} is given twice")
        put(self, "names", tuple(names))
        if self.atol is not None:
            several = not is_number(self.atol)
            given = _listed("atol", self.atol) if several else [self.atol]
            if several and len(given) != len(values):
                raise InputError(f"{self.name}: atol: expected one number or {len(values)}, got {len(given)}")
            for k, each in enumerate(given):
                positive(f"{self.name}: atol" + (f"[{k}]" if several else ""), each)
            put(self, "atol", tuple(map(float, given)) if several else float(self.atol))
        if not isinstance(self.velocity_dependent, bool):
            raise InputError(
                f"{self.name}: velocity_dependent must be True or False, got {shown(self.velocity_dependent)}"
            )

    def __str__(self) -> str:
        functions = [each.__name__ for each in (self.f, self.acts) if each is not None]
        return f"Beside({', '.join(self.names)}: {' and '.join(functions)})"

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return len(self.y0)

    @property
    def works(self) -> bool:
        """Whether the unknowns act on the bodies, whose energy is then not conserved."""
        return self.acts is not None

    @property
    def external(self) -> bool:  # type: ignore[override]
        """Whether the total momentum changes."""
        return self.acts is not None

    def reversed(self) -> Beside:
        """The force of the mirrored motion, at t = -s and with velocities of the other sign."""
        other = copy(self)
        object.__setattr__(other, "sign", -self.sign)
        return other

    def check(self, system: Subject) -> None:
        """Call the functions at the start of the system. Refuse a wrong result, and a name that a body has."""
        for each in self.names:
            if each in system.names:
                raise InputError(f"{self.name}: names: {each!r} is a body of the system; give the unknown another name")
        state = system.state
        bodies = Bodies(state.phase[0].copy(), state.phase[1].copy(), system.coherent_masses.copy())
        self.rates(float(state.time), bodies)
        if self.acts is None:
            return
        pushed = self._pushed(float(state.time), bodies)
        faster = bodies._replace(v=bodies.v + 1.0 + np.abs(bodies.v).max())
        if not self.velocity_dependent and not np.array_equal(pushed, self._pushed(float(state.time), faster)):
            raise InputError(f"{self.name}: acts depends on velocity; say so: velocity_dependent=True")
        if system.dimensions == 2 and pushed[2].any():
            raise InputError(f"{self.name}: acts pushes bodies out of the plane of two dimensions")

    def reads_velocities(self, system: Any) -> bool:
        """Whether the rates depend on the bodies' velocities at the start."""
        state = system.state
        bodies = Bodies(state.phase[0].copy(), state.phase[1].copy(), system.coherent_masses.copy())
        faster = bodies._replace(v=bodies.v + 1.0 + np.abs(bodies.v).max())
        return not np.array_equal(self.rates(float(state.time), bodies), self.rates(float(state.time), faster))

    def rates(self, time: float, bodies: Bodies) -> Floats:
        """The rates at the start, by plain Python."""
        given = self._called("f", time, np.array(self.y0), bodies)
        try:
            values = np.atleast_1d(np.asarray(given, dtype=float))
        except (TypeError, ValueError):
            values = np.zeros((0, 0))
        if values.shape != (self.unknowns,):
            count = values.size if values.ndim == 1 else shown(given)
            raise InputError(f"{self.name}: f(t, y, bodies) must return {self.unknowns} numbers; it returned {count}")
        self._check_finite("f(t, y, bodies)", "rate of", values, self.names)
        return values

    def _pushed(self, time: float, bodies: Bodies) -> Floats:
        """Accelerations (3, n) by the unknowns at the start, by plain Python."""
        a = np.zeros_like(bodies.x)
        energy = self._called("acts", time, np.array(self.y0), bodies, a)
        if not (energy is None or is_number(energy)):
            raise InputError(
                f"{self.name}: acts(t, y, bodies, a) must return the energy or None; it returned {shown(energy)}"
            )
        numbers = [*np.abs(a).sum(axis=0), *([] if energy is None else [float(energy)])]
        labels = [*(f"particle {i}" for i in range(a.shape[1])), "the energy"]
        self._check_finite("acts(t, y, bodies, a)", "value for", np.array(numbers), labels)
        return a

    def _called(self, key: str, *given: Any) -> Any:
        function = getattr(getattr(self, key), "py_func", getattr(self, key))
        try:
            with np.errstate(all="ignore"):
                return function(*given)
        except Exception as error:  # whatever a user's function raises
            text = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{self.name}: {key} raised {text}{raised_at(error.__traceback__)}") from None

    def _check_finite(self, what: str, of: str, values: Floats, labels: Sequence[str]) -> None:
        if (wrong := np.flatnonzero(~np.isfinite(values))).size:
            k = int(wrong[0])
            raise InputError(f"{self.name}: {what} must return finite numbers; the {of} {labels[k]} is {values[k]}")

    def bind(self, system: Any, threads: int = 1) -> Any:
        """See Field."""
        from kickdrift.forces.beside.unknowns_kernel import bound_unknowns

        first = sum(kind.first(force, system).shape[-1] for force, kind in _before(system))
        return bound_unknowns(self, len(system) + first, system.coherent_masses)


def _before(system: Any) -> list[tuple[Any, Columns]]:
    """The forces whose columns stand before those of the unknowns."""
    kinds = ((force, COLUMNS.get(force.name)) for force in system.forces)
    return [(force, kind) for force, kind in kinds if kind is not None and kind.moments]


def _listed(key: str, value: Any) -> list[Any]:
    if isinstance(value, str | Mapping):
        raise InputError(f"{Beside.name}: {key}: expected a list, got {shown(value)}")
    try:
        return list(np.atleast_1d(value)) if isinstance(value, np.ndarray | float | int) else list(value)
    except TypeError:
        raise InputError(f"{Beside.name}: {key}: expected a list, got {shown(value)}") from None


def _one(k: int, values: Floats) -> float:
    return float(values[k])


def _rows(force: Beside, system: Any) -> list[tuple[str, str, tuple[int, ...], Callable[[Floats], Any]]]:
    return [(name, "", (), partial(_one, k)) for k, name in enumerate(force.names)]


def names_in(record: Any) -> list[str]:
    """Names of the unknowns in the record of a run's System; [] without any."""
    forces = record.get("forces") if isinstance(record, dict) else None
    for each in forces if isinstance(forces, list) else ():
        if isinstance(each, dict) and (each.get("module"), each.get("type")) == ("kickdrift", Beside.__qualname__):
            names = (each.get("parameters") or {}).get("names")
            if isinstance(names, list) and all(isinstance(name, str) for name in names):
                return names
    return []


COLUMNS[Beside.name] = Columns(
    UNKNOWNS,
    first=lambda force, system: np.array(force.y0),
    begun=lambda force, values: replace(force, y0=tuple(values.tolist())),
    listed=_rows,
)
