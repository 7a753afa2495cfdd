"""`PythonForce`: a plain Python function as a force. Importing this module compiles nothing."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.external.turns import Question, asked
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.seam.arguments import check_massive
from kickdrift.forces.seam.named import found, is_function, named
from kickdrift.model.checks.arguments import checked_arguments, misfit
from kickdrift.text import counted, shown

if TYPE_CHECKING:
    from kickdrift.forces.external.kernel import ExternalKernel
    from kickdrift.model.box.box import Box
    from kickdrift.model.state import Floats
    from kickdrift.model.subject import Subject

SHAPE = "expected (forces, energy) or (forces, energy, virial)"
NO_TENSOR = "returns its virial as one number; let it return a matrix (3, 3), the sum of r F^T over pairs"
MIXED = 1e-3  # relative difference of one replica's forces in two calls; single precision has 1e-6
LATER = 0.37  # time of a trial, to see whether a function depends on time


@checked_arguments
@dataclass(frozen=True)
class PythonForce(Field):
    """A plain function ``f(positions, velocities, time, box)`` that returns ``(forces, energy)``.

    Compiled step loops call the function at each evaluation of the forces, so a step costs as much as the function and
    a few microseconds. Every method, file and restart serves the function as it serves other forces.

    ``positions`` and ``velocities`` are (n, 3), in the system's units, and read-only. The next call overwrites them.
    ``box`` is the system's `Box`. ``forces`` are (n, 3), an energy per length, also for massive particles in metal
    units. ``energy`` is a number, or None for a force without potential energy, which needs ``works=True``. A third
    value is the virial: the sum of r . F over pairs of particles, or the matrix (3, 3) of the sums of r_a F_b, with
    which a barostat can change edges apart. Without the virial, samples have no pressure.

    A run's file stores the import path of the function. ``kd.resume`` finds the function again if the program has made
    a force of it; on the command line, ``--load FILE.py`` runs a file that does so. A function inside another function
    has no path: give ``kd.resume`` the system.

    Parameters
    ----------
    function : the function, or the import path of one that this program has named
    velocity_dependent, time_dependent : whether forces depend on velocities, or on time
        A force that depends on one of them and does not say so is refused.
    works : whether the force does work that its energy does not count, such as friction
    external : whether the force changes the total momentum; default true
    batch : whether the function takes several replicas of the system at once: positions and velocities (r, n, 3),
        times (r,) and a list of r boxes. It returns forces (r, n, 3) and energies (r,), and virials (r,) or (r, 3, 3)
        if it has them. An `Ensemble` asks such a function for all members of a task in one call; elsewhere r is 1

    Raises
    ------
    InputError
        When a System is made, for a function that raises, or returns anything else, at the system's positions.
    """

    function: Any
    velocity_dependent: bool = False
    time_dependent: bool = False
    works: bool = False
    external: bool = True  # type: ignore[misc]
    batch: bool = False

    name: ClassVar[str] = "python"
    dimensions: ClassVar[dict[str, str]] = {}

    def __post_init__(self) -> None:
        if isinstance(self.function, str):
            object.__setattr__(self, "function", found(f"{self.name}: function", self.function, is_function))
        if not callable(self.function):
            raise InputError(f"{self.name}: function: expected a function, got {shown(self.function)}")
        if signature := misfit(self.function, None, None, None, None):
            raise InputError(f"{self.name}: function must take (positions, velocities, time, box), not {signature}")
        for key in ("velocity_dependent", "time_dependent", "works", "external", "batch"):
            if not isinstance(getattr(self, key), bool):
                raise InputError(f"{self.name}: {key} must be True or False, got {shown(getattr(self, key))}")
        named(self.function)

    def __str__(self) -> str:
        return f"PythonForce({self.label})"

    @property
    def label(self) -> str:
        """The function's name."""
        return str(getattr(self.function, "__name__", type(self.function).__name__))

    @property
    def thermal(self) -> bool:
        """Whether particles act on each other, so that samples have a temperature."""
        return not self.external

    @property
    def _backward(self) -> bool:
        return bool(vars(self).get("backward", False))

    def reversed(self) -> PythonForce:
        """The force of the mirrored motion, at t = -s and velocities of the other sign."""
        other = copy(self)
        object.__setattr__(other, "backward", not self._backward)
        return other

    def no_pressure(self, system: Subject) -> str:
        """Why samples have no pressure; "" if they have one."""
        lacking = np.isfinite(system.volume) and not vars(self).get("virial", False)
        return f"the function {self.label} returns no virial" if lacking else ""

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: a function with a virial follows the box."""
        return self.no_pressure(system)

    def fixes_shape(self, system: Subject) -> str:
        """See Grouped: a virial along each axis is needed."""
        return "" if vars(self).get("tensor", False) else f"the function {self.label} {NO_TENSOR}"

    def check(self, system: Subject) -> None:
        """Call the function at the system's positions. Refuse a wrong result and an undeclared dependence."""
        check_massive(self.name, system, range(len(system)))
        state = system.state
        try:
            self._check(system, state.positions, state.velocities, float(state.time))
        except InputError as error:
            raise InputError(f"{self.name}: {self.label}: {error}") from None
        except Exception as error:
            what = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{self.name}: {self.label} raised {what} at the system's positions") from error

    def _check(self, system: Subject, x: Floats, v: Floats, time: float) -> None:
        if self.batch:
            self._check_batch((x, v, time, system.box))
        forces, _, virial, along = answer_of(self.asked(x, v, time, system.box), len(system), self.works)
        object.__setattr__(self, "virial", not np.isnan(virial))
        object.__setattr__(self, "tensor", not np.isnan(along).any())
        trials = {
            "velocity_dependent": (x, v + 1.0 + np.abs(v).max(), time),
            "time_dependent": (x, v, time + LATER),
        }
        for key, given in trials.items():
            if getattr(self, key):
                continue
            try:
                other, *_ = answer_of(self.asked(*given, system.box), len(system), self.works)
            except Exception:  # the function need not be defined for this trial
                continue
            if not np.array_equal(forces, other, equal_nan=True):
                raise InputError(f"depends on {key.split('_')[0]}, or on chance; say so: {key}=True")

    def _check_batch(self, given: tuple[Floats, Floats, float, Box]) -> None:
        """Refuse a function whose replicas depend on one another: the same replica alone and beside another."""
        x, v, time, box = given
        alone = self._together([given])[0]
        try:
            beside = self._together([given, (x[::-1], v[::-1], time, box)])[0]
        except InputError:
            raise
        except Exception:  # the function need not be defined for this trial
            beside = self._together([given, given])[0]
        for key, one, other in zip(("forces", "energy", "virial"), alone, beside, strict=False):
            if one is not None and not np.allclose(one, other, rtol=MIXED, atol=MIXED * np.abs(one).max()):
                raise InputError(f"batch: another replica beside a replica changes its {key}")

    def asked(self, x: Floats, v: Floats, time: float, box: Box) -> Any:
        """What the function returns for this motion, or for its mirror image."""
        given = (x, -v, -time, box) if self._backward else (x, v, time, box)
        if not self.batch:
            return self.function(*given)
        return asked(Question((id(self.function), len(x)), self._together, given))

    def _together(self, given: list[tuple[Floats, Floats, float, Box]]) -> list[tuple[Any, ...]]:
        """What a function of several replicas returns, for each of them."""
        x, v, times, boxes = zip(*given, strict=True)
        value = self.function(np.stack(x), np.stack(v), np.array(times), list(boxes))
        if not isinstance(value, tuple | list) or len(value) not in (2, 3):
            raise InputError(f"returned {shown(value)}, {SHAPE}")
        forces, *numbers = value
        shape = (len(x), len(x[0]), 3)
        if np.shape(forces) != shape:
            raise InputError(
                f"returned forces of shape {np.shape(forces)}, expected {shape}: {counted(len(x), 'replica')}"
            )
        for key, each in zip(("energies", "virials"), numbers, strict=False):
            if key == "virials" and np.shape(each) == (len(x), 3, 3):
                continue
            if each is not None and np.shape(each) != (len(x),):
                raise InputError(
                    f"returned {key} of shape {np.shape(each)}, expected ({len(x)},): one for each replica"
                )
        columns = [[None] * len(x) if each is None else list(np.asarray(each)) for each in numbers]
        return list(zip(np.asarray(forces, dtype=float), *columns, strict=True))

    def bind(self, system: Subject, threads: int = 1) -> ExternalKernel:
        """See Field."""
        from kickdrift.forces.external.kernel import Host

        force = self

        class Function(Host):
            def answer(self, time: float, aside: bool) -> None:
                value = force.asked(self.positions, self.velocities, time, self.box_now)
                self.put(*answer_of(value, len(self.positions), force.works))

        host = Function(
            self.label,
            1.0 / system.coherent_masses,
            system.box,
            moving=self.velocity_dependent,
            clocked=self.time_dependent,
            pairs=np.nan if self.thermal else 0.0,
        )
        return host.parts


def answer_of(value: Any, n: int, works: bool) -> tuple[Floats, float, float, Floats]:
    """Forces (n, 3), energy, virial and its six components (`in_voigt`) that a function returned; nan if unknown.

    Raises InputError for anything else."""
    if not isinstance(value, tuple | list) or len(value) not in (2, 3):
        raise InputError(f"returned {shown(value)}, {SHAPE}")
    forces = np.asarray(value[0], dtype=float)
    if forces.shape != (n, 3):
        raise InputError(f"returned forces of shape {forces.shape}, expected {(n, 3)}")
    if value[1] is None and not works:
        raise InputError("returned no energy; a force without potential energy needs works=True")
    energy = 0.0 if value[1] is None else _number("energy", value[1])
    given: Any = value[2] if len(value) == 3 else None
    if np.shape(given) == (3, 3):
        along = in_voigt(np.asarray(given, dtype=float))
        return forces, energy, float(along[:3].sum()), along
    virial = float("nan") if given is None else _number("virial", given)
    return forces, energy, virial, np.full(6, np.nan)


def in_voigt(matrix: Floats) -> Floats:
    """Components (6,) xx, yy, zz, yz, xz and xy of a matrix (3, 3), which is symmetric but for rounding."""
    both: Floats = 0.5 * (matrix + matrix.T)
    return both[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]]


def _number(what: str, value: Any) -> float:
    if np.size(value) != 1 or np.asarray(value).dtype.kind not in "iuf":
        raise InputError(f"returned {shown(value)} as its {what}, expected a number")
    return float(np.asarray(value).reshape(()))
