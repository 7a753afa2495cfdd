"""The user's own integrators: rows of numbers with their measured order, or a Python step compiled into the loop."""

from __future__ import annotations

import math
import sys
from collections import namedtuple
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.disk.files import refuse_unfit
from kickdrift.errors import InputError
from kickdrift.forces.seam.named import load_module, name_functions
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import Option, own_options
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import Splitting, even_weights, in_turn
from kickdrift.integrators.splitting.subflows import DRIFT, KICK
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper


Step = Callable[[float, Floats, float], Floats]

ECCENTRICITY = 0.2
TIME = 1.0  # of the orbit, whose period is 2 pi
GROWTH = 1.25  # ratio of the numbers of steps of two runs that are compared
MOST_STEPS = 3000
LARGEST, SMALLEST = 1e-3, 1e-12  # errors between which the slope is taken; rounding is about 1e-15 a step
SHORTFALL = 0.3  # of the stated order, that a slope between finite steps may miss


def refuse_lower_order(method: Method) -> None:
    """Refuse a method whose measured order is below the stated one."""
    found = measured_order(method)
    if found < method.order - SHORTFALL:
        raise InputError(f"{method.name}: the order is stated as {method.order}, but measured as {found:.1f}")


def measured_order(method: Method) -> float:
    """Return the slope of log error against log dt at the shortest steps whose error is above rounding.

    The problem is a Kepler orbit in the plane with e = 0.2, beside z' = z cos t for a tableau, so that f depends on
    time. Both have exact solutions. An InputError for a method of another family, or for further flows."""
    step, start, end = _stepping(method)
    slopes, before = [], None
    steps = 4
    while steps <= MOST_STEPS:
        error = _error(step, start, end, steps)
        if error < SMALLEST:
            break
        if before and LARGEST > before[1] > error:
            slopes.append(math.log(before[1] / error) / math.log(steps / before[0]))
        before = (steps, error)
        steps = max(steps + 1, round(steps * GROWTH))
    if not slopes:
        raise InputError(
            f"{method.name}: the order cannot be measured; no error lies between {SMALLEST:g} and {LARGEST:g}"
        )
    return float(np.median(slopes[-5:]))


def _stepping(method: Method) -> tuple[Step, Floats, Floats]:
    """Return the step, the start and the exact end."""
    if isinstance(method, Splitting) and not method.further:
        return _splitting_step(method), kepler(0.0), kepler(TIME)
    if isinstance(method, Tableau):
        return _tableau_step(method), np.append(kepler(0.0), 1.0), np.append(kepler(TIME), math.exp(math.sin(TIME)))
    raise InputError(f"{method.name}: the order is measured for splittings of kicks and drifts, and for tableaus")


def kepler(t: float) -> Floats:
    """Position and velocity (4,) at a time after the pericentre, for a = GM = 1."""
    e, anomaly = ECCENTRICITY, t
    for _ in range(50):  # Newton's iteration of Kepler's equation
        anomaly -= (anomaly - e * math.sin(anomaly) - t) / (1 - e * math.cos(anomaly))
    c, s, b = math.cos(anomaly), math.sin(anomaly), math.sqrt(1 - e * e)
    return np.array([c - e, b * s, -s / (1 - e * c), b * c / (1 - e * c)])


def _pull(x: Floats) -> Floats:
    pull: Floats = -x / math.hypot(x[0], x[1]) ** 3
    return pull


def _splitting_step(method: Splitting) -> Step:
    def step(t: float, y: Floats, dt: float) -> Floats:
        y = y.copy()
        for letter, weight in zip(method.letters, method.weights, strict=True):
            if letter == DRIFT:
                y[:2] += weight * dt * y[2:]
            elif letter[0] == KICK:
                y[2:] += weight * dt * _pull(y[:2]) / max(1, method.groups)
        return y

    return step


def _tableau_step(method: Tableau) -> Step:
    def slope(t: float, y: Floats) -> Floats:
        return np.array([*y[2:4], *_pull(y[:2]), y[4] * math.cos(t)])

    def step(t: float, y: Floats, dt: float) -> Floats:
        stages: list[Floats] = []
        for c, row in zip(method.c, ((), *method.a), strict=False):
            stages.append(slope(t + c * dt, y + dt * sum(w * k for w, k in zip(row, stages, strict=True))))
        return y + dt * sum(w * k for w, k in zip(method.b, stages, strict=True))

    return step


def _error(step: Step, start: Floats, end: Floats, steps: int) -> float:
    y, dt = start, TIME / steps
    for k in range(steps):
        y = step(k * dt, y, dt)
    return float(np.abs(y - end).max())


REGISTERED: set[str] = set()  # names of the user's integrators


@dataclass(frozen=True)
class CompiledStep(Method):
    """A user's step function, compiled into its own loop; see ``register_step``."""

    name: str
    function: Callable[..., None]
    order: int
    source: str
    use: str = ""
    evaluations: int = 1
    symplectic: bool = False
    reversible: bool = False
    separable: bool = True
    declared: tuple[Option, ...] = ()
    kind: Any = field(default=None, repr=False)

    family = "compiled step"

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.own.custom import custom_loop
        from kickdrift.integrators.stepping.stepping import FixedStepper

        if flow.halves != 2:
            raise InputError(f"{self.name}: a compiled step needs positions and velocities; {flow.not_separable}")
        values = self.kind(tuple(options[each.name] for each in self.declared) if self.declared else 0.0)
        return FixedStepper(flow, custom_loop, values, lambda shape: np.zeros((3, *shape[1:])), options, kept=True)


def register_splitting(
    name: str,
    kick: Sequence[float] | None = None,
    drift: Sequence[float] | None = None,
    *,
    word: str | None = None,
    weights: Sequence[float] | None = None,
    first: str = "kick",
    order: int,
    source: str,
    use: str = "",
    check_order: bool = False,
    overwrite: bool = False,
) -> None:
    """Add a splitting method: a word over flows, or kicks and drifts in turn.

    ``register_splitting("mine", word="ABA", order=2, source="…")`` is position Verlet.

    Parameters
    ----------
    name : a new one; with ``overwrite``, one that was registered before
    word : the flows in the order in which they act: "A" drifts, "B" kicks, and one letter may be a heat bath, such as
        "O"; ``docs/your-own-integrator.md`` has all letters. "B0" and "B1" kick by the forces of one group. "(B0 A
        B0)4" repeats a part, so "B1 (B0 A B0)4 B1" has two time steps
    weights : the part of dt for each letter, those of one letter adding up to one; equal parts by default
    kick, drift : in place of a word, the weights of dt of kicks and drifts in turn, each adding up to one
    first : "kick" or "drift", whichever comes first where no word is given
    order : the power of dt in the global error
    source : author, year, DOI
    use : what it is good for, for ``kickdrift list integrators``
    check_order : measure the order on a Kepler orbit, and refuse the method if the measured order is lower

    Raises
    ------
    InputError
        If the weights make no method, the name is taken, or the measured order is below ``order``.
    """
    if word is None:
        if kick is None or drift is None or weights is not None:
            raise InputError(f"{name}: give a word, or kick and drift")
        word, row = _kicks_and_drifts(name, _row(name, "kick", kick), _row(name, "drift", drift), first)
    elif kick is not None or drift is not None:
        raise InputError(f"{name}: give a word, or kick and drift, not both")
    else:
        if not (isinstance(word, str) and word):
            raise InputError(f"{name}: word must be letters of flows, got {word!r}")
        row = even_weights(word, name) if weights is None else _row(name, "weights", weights)
    _register(Splitting(name, word, row, order, source, use), overwrite, check_order)


def _kicks_and_drifts(
    name: str, kick: tuple[float, ...], drift: tuple[float, ...], first: str
) -> tuple[str, tuple[float, ...]]:
    """The word of kicks and drifts in turn, and its weights."""
    if first not in ("kick", "drift"):
        raise InputError(f"{name}: first must be kick or drift, got {first!r}")
    try:
        return in_turn("BA", kick, drift) if first == "kick" else in_turn("AB", drift, kick)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def register_tableau(
    name: str,
    a: Sequence[Sequence[float]],
    b: Sequence[float],
    *,
    order: int,
    source: str,
    use: str = "",
    errors: Sequence[Sequence[float]] = (),
    error_order: int = 0,
    check_order: bool = False,
    overwrite: bool = False,
) -> None:
    """Add an explicit Runge-Kutta method: ``a`` the rows below the diagonal from the second stage on, ``b`` the
    weights.

    ``errors`` and ``error_order`` make it adaptive. ``errors`` is one row of weights of the error estimate, for the
    stages and for f(t + dt, y_new). ``error_order`` is the order of the embedded solution. The other parameters are as
    in ``register_splitting``.
    """
    rows = tuple(_row(name, "a", row) for row in a)
    estimates = tuple(_row(name, "errors", row) for row in errors)
    made = Tableau(name, rows, _row(name, "b", b), order, source, use, estimates, error_order)
    _register(made, overwrite, check_order)


def register_step(
    name: str,
    *,
    order: int,
    source: str,
    evaluations: int = 1,
    symplectic: bool = False,
    reversible: bool = False,
    separable: bool = True,
    use: str = "",
    options: Sequence[Option] = (),
    overwrite: bool = False,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator that adds a method whose step is a Python function, compiled with the forces at native speed.

    The function is ``step(forces, t, x, v, a, dt)``. It changes positions ``x`` and velocities ``v``, arrays of shape
    (rows, n), in place, from t to t + dt. ``kd.accelerations(forces, t, x, v, a)`` fills ``a``. Do not rely on the
    content of ``a`` from the last step. ``separable=False`` allows forces that depend on velocity.

    ``options`` declares numbers or switches that the step takes, each a ``kd.Option`` with a default. Their values
    follow dt in their order: ``step(forces, t, x, v, a, dt, friction)``. A Simulation takes them as keywords, a system
    file in ``[run]``, the command line as ``-o friction=0.1``.
    """
    declared = own_options(options)
    for each in declared:
        if each.type is str or each.several or each.count > 1 or each.default is None or not each.written:
            raise InputError(f"option {each.name}: of a compiled step is a number or a switch, and has a default")

    def register(function: Callable[..., None]) -> Callable[..., None]:
        fields = ["options" if declared else "unused"]
        kind = namedtuple("Step_" + "".join(c if c.isalnum() else "_" for c in name), fields)  # type: ignore[misc]
        kind.__module__ = function.__module__  # the cache is kept by the source of this module
        kind.kernel_sources = (function,)  # type: ignore[attr-defined]
        _register(
            CompiledStep(
                name, function, order, source, use, evaluations, symplectic, reversible, separable, declared, kind
            ),
            overwrite,
        )
        return function

    return register


def unregister(name: str) -> None:
    """Remove a registered method."""
    if name not in REGISTERED:
        raise InputError(f"integrator {name!r} is not registered")
    REGISTERED.discard(name)
    del INTEGRATORS[name]


def load_file(path: Path) -> None:
    """Run a Python file that registers methods or forces. Files may then name its functions as rules of collisions.

    Raises an InputError of one line if the file fails."""
    name_functions(executed(path))


def load_code(path: Path) -> None:
    """Run a Python file, or import a module that is given by its dotted name, such as ase.calculators.emt. Files may
    then name what they define."""
    name = str(path)
    if name.endswith(".py") or path.exists() or not all(part.isidentifier() for part in name.split(".")):
        load_file(path)
    else:
        load_module(name)


def executed(path: Path) -> ModuleType:
    """Run a Python file and return its module. Raises an InputError of one line if the file fails."""
    refuse_unfit(path)
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path}: a Python file's name must end in .py")
    module = module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    return module


def _row(name: str, key: str, weights: Sequence[float]) -> tuple[float, ...]:
    try:
        return tuple(float(weight) for weight in weights)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {key} must be a row of numbers, got {weights!r}") from None


def _register(method: Method, overwrite: bool, measured: bool = False) -> None:
    name = method.name
    if not (isinstance(name, str) and name and name == name.strip()):
        raise InputError(f"an integrator's name must be one word, got {name!r}")
    if name in INTEGRATORS and not (overwrite and name in REGISTERED):
        hint = "; overwrite=True replaces it" if name in REGISTERED else ""
        raise InputError(f"integrator {name!r} exists already{hint}")
    if not (isinstance(method.order, int) and method.order >= 1):
        raise InputError(f"{name}: order must be a whole number, one or more, got {method.order!r}")
    if not method.source:
        raise InputError(f"{name}: source must say where the method was published")
    if measured:
        refuse_lower_order(method)
    INTEGRATORS[name] = method
    REGISTERED.add(name)
