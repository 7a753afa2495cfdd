"""`CalculatorForce`: a calculator of ASE's as a force. Importing this module imports neither ASE nor numba."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar
from weakref import WeakValueDictionary

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.seam.arguments import check_massive
from kickdrift.forces.seam.named import found, is_calculator, named, path_of, takes_batches
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.units.file_units import FileUnits, Scale
from kickdrift.text import choices, shown

if TYPE_CHECKING:
    from kickdrift.forces.external.kernel import ExternalKernel
    from kickdrift.model.subject import Subject

RENEWAL = 0.25  # angstrom; ASE's neighbour lists serve moves of up to 0.3
NO_ELEMENT = "X"  # ASE's symbol for no element
_SHARED: WeakValueDictionary[tuple[Any, str], Any] = WeakValueDictionary()  # by class and arguments
PASSING = {"atoms", "results"}  # what a calculator keeps of its last calculation
OBJECT = "an object of the program"  # arguments of a calculator that was given ready-made


@checked_arguments
@dataclass(frozen=True)
class CalculatorForce(Field):
    """A calculator of ASE as a force: ``kd.CalculatorForce(EMT())``, or ``kd.CalculatorForce(EMT, {…})``.

    Compiled step loops call the calculator at each evaluation of the forces, so a step costs as much as the calculator
    and some microseconds. Samples at the positions of the last evaluation cost no second calculation. Units are
    converted as in `System.from_ase`. The calculator's Atoms share the memory of the positions, so nothing unchanged is
    copied. ASE: Larsen et al. 2017, doi:10.1088/1361-648X/aa680e.

    A calculator with a class and arguments can be made again, so a run's file stores the import path and the
    arguments. ``kd.resume`` makes the calculator again if the program has named the class, by this force or by
    ``kd.register_force``; on the command line by ``--load MODULE``. A ready-made calculator is stored by its class and
    its parameters (``todict`` of ASE), if the class makes the same calculator of them. Else, as for a sum of
    calculators, give ``kd.resume`` the system.

    A calculator may keep memory between calls, such as a neighbour list, so its results may depend on earlier calls, to
    rounding. Therefore kickdrift makes the calculator begin anew (``calculator.reset()``, all changes) when an atom has
    moved by ``renewal`` since the last beginning, and stores the positions of that beginning in checkpoints. A resumed
    run has the same bits if the memory lasts at least until the next beginning, as that of ASE's own lists does. With
    ``renewal=0`` each evaluation begins anew.

    A calculator may offer ``calculate_batch(list_of_atoms, properties)``, which returns a list with a table of results
    for each Atoms, and must keep no memory between calls. An `Ensemble` asks such a calculator for all members of a
    task in one call. A process makes such a calculator once for the same class and arguments.

    Parameters
    ----------
    calculator : a calculator, its class or a function that makes it, or the import path of one of these
        In a module of ``--load``, a path finds only classes of calculators.
        Several forces may share a calculator, but a run then begins it anew more often.
    arguments : keyword arguments of the class or function
    symbols : chemical elements by species; default the species' own names
    stress : whether to calculate the stress as well, for the pressure; default true
    renewal : length; default 0.25 angstrom

    Raises
    ------
    InputError
        Without ASE; for a calculator without energy and forces; when a System is made, for two dimensions, particles
        without mass, and species that are no elements.
    """

    calculator: Any
    arguments: Any = None
    symbols: Any = None
    stress: bool = True
    renewal: float | None = None

    name: ClassVar[str] = "ase"
    may_overlap: ClassVar[bool] = False
    external: ClassVar[bool] = False
    thermal: ClassVar[bool] = True  # particles act on each other, so that samples have a temperature
    dimensions: ClassVar[dict[str, str]] = {"renewal": "length"}

    def __post_init__(self) -> None:
        put = object.__setattr__
        code, arguments = self.calculator, self.arguments
        for key in ("arguments", "symbols"):
            if key == "arguments" and arguments == OBJECT:
                raise InputError(
                    f"{self.name}: the file cannot say how the calculator {shown(code)} was made; give the system: "
                    "kd.resume(path, system=system)"
                )
            if not isinstance(getattr(self, key), Mapping | None):
                raise InputError(f"{self.name}: {key}: expected a table, got {shown(getattr(self, key))}")
        if not isinstance(self.stress, bool):
            raise InputError(f"{self.name}: stress must be True or False, got {shown(self.stress)}")
        if self.renewal is not None and not (np.ndim(self.renewal) == 0 and self.renewal >= 0):
            raise InputError(f"{self.name}: renewal must be a length, zero or more, got {shown(self.renewal)}")
        if isinstance(code, str):
            code = found(f"{self.name}: calculator", code, is_calculator)
        ready = not isinstance(code, type) and hasattr(code, "calculate")
        if ready and arguments:
            raise InputError(f"{self.name}: arguments belong to a class of calculators, and this one is ready-made")
        if not ready and not callable(code):
            raise InputError(f"{self.name}: calculator: expected one of ASE's calculators, got {shown(code)}")
        made = code if ready else _shared(self.name, code, dict(arguments or {}))
        _check(self.name, made)
        said = _parameters(made) if ready else dict(arguments or {})
        stored = said is not None and _storable(said)
        put(self, "calculator", named(type(made) if ready else code) if stored or not ready else path_of(type(made)))
        put(self, "arguments", said if stored else OBJECT)
        put(self, "symbols", None if self.symbols is None else dict(self.symbols))
        put(self, "made", made)

    def __str__(self) -> str:
        return f"CalculatorForce({self.label})"

    @property
    def label(self) -> str:
        """Name of the calculator's class."""
        made: Any = vars(self)["made"]
        return type(made).__name__

    @property
    def batch(self) -> bool:
        """Whether the calculator takes several replicas at once."""
        return takes_batches(vars(self)["made"])

    @property
    def unwritable(self) -> str:
        """Why a system file cannot name this force; "" if it can."""
        ready = self.arguments == OBJECT
        return f"a system file cannot say how the calculator {self.label} was made; give its class" if ready else ""

    def no_pressure(self, system: Subject) -> str:
        """Why samples have no pressure; "" if they have one."""
        if not np.isfinite(system.volume):
            return ""  # open space has no pressure anyway
        if "stress" not in vars(self)["made"].implemented_properties:
            return f"the calculator {self.label} gives no stress"
        return "" if self.stress else "stress=False leaves it out"

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: a calculator with stress follows the box."""
        return self.no_pressure(system)

    def check(self, system: Subject) -> None:
        """Refuse two dimensions, particles without mass, and species that are no elements."""
        if system.dimensions == 2:
            raise InputError(f"{self.name}: a calculator needs three dimensions, and the system has two")
        check_massive(self.name, system, range(len(system)))
        self.elements(system)

    def elements(self, system: Subject) -> dict[str, str]:
        """Chemical elements by species."""
        from ase.data import atomic_numbers

        given = self.symbols or {}
        for kind in given:
            if kind not in system.species:
                raise InputError(
                    f"{self.name}: symbols: no species {shown(kind)}; known are {choices(system.species, kind)}"
                )
        nominal = FileUnits.of(system.units).nominal
        elements = {}
        for kind in system.species:
            symbol = given.get(kind, kind)
            if symbol not in atomic_numbers and kind not in given and nominal:
                symbol = NO_ELEMENT
            if symbol not in atomic_numbers:
                raise InputError(
                    f"{self.name}: {shown(symbol)} for species {shown(kind)} is not a chemical element; "
                    f'symbols={{"{kind}": "Cu"}} names it'
                )
            elements[kind] = symbol
        return elements

    def bind(self, system: Subject, threads: int = 1) -> ExternalKernel:
        """See Field."""
        from kickdrift.forces.external.atoms import calculator_host

        scale = Scale.of(system.units)
        reach = RENEWAL if self.renewal is None else self.renewal / scale.length
        stress = not self.no_pressure(system) and bool(np.isfinite(system.volume))
        return calculator_host(vars(self)["made"], self.label, self.elements(system), system, reach, stress).parts


def _shared(name: str, code: Any, arguments: dict[str, Any]) -> Any:
    """The calculator that a class or function makes; the same one for all forces if it takes batches."""
    key = (code, json.dumps(arguments, sort_keys=True) if _storable(arguments) else "")
    made = _SHARED.get(key) or _made(name, code, arguments)
    if key[1] and takes_batches(made):
        _SHARED[key] = made
    return made


def _made(name: str, code: Any, arguments: dict[str, Any]) -> Any:
    """The calculator that a class or function makes."""
    try:
        return code(**arguments)
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        given = ", ".join(f"{key}={shown(value)}" for key, value in arguments.items())
        raise InputError(f"{name}: calculator: {path_of(code)}({given}) raised {what}") from error


def _parameters(made: Any) -> dict[str, Any] | None:
    """Arguments with which the class makes a calculator equal to this ready-made one; None if there are none.

    The two are compared by their parameters, and by all plain values that a new calculator has."""
    cls = type(made)
    if "<" in path_of(cls):
        return None
    try:
        said = dict(made.todict())
        again = cls(**said)
        same = dict(again.todict()) == said and all(
            _same(value, vars(made).get(key)) for key, value in vars(again).items() if key not in PASSING
        )
    except Exception:  # whatever a calculator raises that needs more
        return None
    return said if same else None


def _same(value: Any, other: Any) -> bool:
    """Whether two values are equal, as far as they are numbers, text, arrays, or lists and tables of these. What a new
    calculator does not have yet, such as a neighbour list, may be there in the other one."""
    if value is None:
        return not isinstance(other, float | int | str | complex | np.ndarray | list | tuple | Mapping)
    if isinstance(value, np.ndarray):
        return isinstance(other, np.ndarray) and np.array_equal(value, other)
    if isinstance(value, list | tuple):
        return type(other) is type(value) and len(value) == len(other) and all(map(_same, value, other))
    if isinstance(value, Mapping):
        return (
            isinstance(other, Mapping) and {*value} == {*other} and all(_same(value[key], other[key]) for key in value)
        )
    return value == other if isinstance(value, float | int | str | complex) else type(other) is type(value)


def _check(name: str, made: Any) -> None:
    """Refuse an object that is no calculator, and a calculator without energy or forces."""
    try:
        import ase  # noqa: F401
    except ImportError:
        raise InputError(f"{name}: a calculator needs ase: pip install 'kickdrift[ase]'") from None
    given = getattr(made, "implemented_properties", None)
    if given is None or not callable(getattr(made, "calculate", None)):
        raise InputError(f"{name}: calculator: expected one of ASE's calculators, got {shown(made)}")
    for wanted in ("energy", "forces"):
        if wanted not in given:
            raise InputError(
                f"{name}: the calculator {type(made).__name__} gives no {wanted}; it gives {', '.join(given)}"
            )


def _storable(arguments: Any) -> bool:
    """Whether a file can hold the arguments and give back the same."""
    try:
        return bool(json.loads(json.dumps(arguments)) == arguments)
    except (TypeError, ValueError, RecursionError):
        return False
