"""Methods that a comparison runs: those that a user names, or a choice that suits the subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from kickdrift.analysis.compare.pilot import Subject
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import Integrator, method_of, refuse_unknown, takers_text, unpacked
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

SPLITTINGS = ("velocity-verlet", "forest-ruth", "pefrl", "blanes-moan4", "yoshida6", "blanes-moan6", "yoshida8")
EXPLICIT = ("midpoint", "rk4", "bogacki-shampine23", "dormand-prince45", "dop853")
STIFF = ("bdf", "radau", "rosenbrock", "lsoda", "dormand-prince45")
BESIDE_SPLITTINGS = ("rk4", "dormand-prince45", "dop853", "gauss-radau15")
ANY_STEP = 1e-3
SUBSTEPS = (2, 4, 8, 16)  # splits that a comparison tries of forces in groups
LADDERED = ("dt", "rtol", "atol", "precision")  # options that a comparison sets itself


def chosen_methods(
    subject: Subject, integrators: Sequence[str | Integrator] | None, options: Mapping[str, Any] | None = None
) -> list[Integrator]:
    """Requested methods without duplicates, each with the ``options`` that it takes.

    Raises InputError for a method that is unknown or cannot run the subject, and for an option that no method takes.
    """
    found: list[Integrator] = []
    refuse_unknown(options or ())
    for each in integrators or ():
        method, own = method_of(each), unpacked(each, {})[1]
        taken = {key: value for key, value in (options or {}).items() if key in method.tunable}
        value = Integrator(method.name, taken | own)
        if value not in found:
            found.append(value)
    for key in {*(options or {}), *(key for each in found for key in each.options)}:
        if key in LADDERED:
            raise InputError(f"{key}: compare sets it: it runs steps and tolerances from coarse to fine, in float64")
        if found and not any(key in each.options for each in found):
            raise InputError(f"{key}: {' or '.join(map(str, found))} does not take it; {takers_text(key)} it")
    for each in found:
        Simulation(subject, each, dt=ANY_STEP)  # raises an InputError for a method that cannot run the subject
    return found


def have_baths(integrators: Sequence[str | Integrator] | None) -> bool:
    """Whether all of these methods have a heat bath. Raises InputError if only some have."""
    methods = [method_of(each) for each in integrators or ()]
    bathed = [method.name for method in methods if method.bath]
    if bathed and len(bathed) < len(methods):
        other = next(method.name for method in methods if not method.bath)
        raise InputError(
            f"compare: {bathed[0]} has a heat bath and {other} has none; compare them apart: paths with noise are "
            "compared by their means, others by their errors"
        )
    return bool(bathed)


def default_integrators(subject: Subject, stiff: bool) -> list[str | Integrator]:
    """Methods that suit the subject.

    Splittings of orders 2 to 8 suit accelerations that depend on positions alone, explicit Runge-Kutta methods other
    equations, and implicit methods stiff ones. Forces in groups are tried with several splits of ``respa`` too.
    """
    names: Sequence[str] = STIFF if stiff else (*SPLITTINGS, *BESIDE_SPLITTINGS) if _separable(subject) else EXPLICIT
    if isinstance(subject, System) and len(subject) > 64:
        names = [name for name in names if name not in ("yoshida8", "dormand-prince45", "gauss-radau15")]
    splits = [Integrator("respa", {"substeps": each}) for each in SUBSTEPS] if grouped(subject) else []
    return [*(name for name in names if name in INTEGRATORS), *splits]


def grouped(subject: Subject) -> bool:
    """Whether the forces of a System are in more than one group."""
    return isinstance(subject, System) and len({getattr(force, "group", 0) for force in subject.forces}) > 1


def _separable(subject: Subject) -> bool:
    if isinstance(subject, System):
        return not any(getattr(force, "velocity_dependent", False) for force in subject.forces)
    return subject.separable
