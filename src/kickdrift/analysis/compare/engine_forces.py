"""One System in every engine: energies by term, forces and pressures, and where they differ most."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.display.showing import Lines, Shown, Table
from kickdrift.engines import ENGINES, Engine
from kickdrift.engines import engine as engine_named
from kickdrift.engines.job import Job
from kickdrift.engines.session import Trouble
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces, Measured
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import Options
from kickdrift.model.state import Floats
from kickdrift.model.system import System

DT = 1e-3  # of the step that an engine asks for and does not take


@dataclass(frozen=True)
class EngineForces:
    """What one engine makes of a System at its start.

    Attributes
    ----------
    engine : its name
    refusal : why it cannot run the System; "" if it can, and then the numbers are not None
    energy : potential energy
    terms : (forces,) energy of each force of the System, in its order; nan where the engine takes neither this force
        alone nor the others alone
    pressure : of this instant; nan in open space and where the engine tells none
    forces : (n, 3)
    largest : largest force on a particle
    difference : largest difference of a particle's force from that of the first engine
    particle : row of the particle where this is
    """

    engine: str
    refusal: str = ""
    energy: float = np.nan
    terms: tuple[float, ...] = ()
    pressure: float = np.nan
    forces: Floats | None = None
    largest: float = 0.0
    difference: float = 0.0
    particle: int = 0


@dataclass(frozen=True, repr=False)
class EngineComparison(Shown):
    """Result of `compare_engines`: a row for each engine. Forces are compared with those of the first that has any."""

    name: str
    names: tuple[str, ...]  # of the forces
    units: tuple[str, str, str]  # symbols of energy, pressure and force
    bodies: tuple[str, ...]  # where each row differs most
    rows: tuple[EngineForces, ...]

    def as_json(self) -> dict[str, Any]:
        """The numbers as one JSON object, without the forces."""
        found = []
        for row, body in zip(self.rows, self.bodies, strict=True):
            plain: dict[str, Any] = {"engine": row.engine, "refusal": row.refusal}
            if not row.refusal:
                terms = [{"force": name, "energy": _number(each)}
                         for name, each in zip(self.names, row.terms, strict=True)]  # fmt: skip
                plain |= {
                    "energy": row.energy, "terms": terms, "pressure": _number(row.pressure),
                    "largest": row.largest, "difference": row.difference, "body": body,
                }  # fmt: skip
            found.append(plain)
        return {"system": self.name, "engines": found}

    def _lines(self) -> Lines:
        return [(row.engine, row.refusal) for row in self.rows if row.refusal]

    def _tables(self) -> list[Table]:
        energy, pressure, force = self.units
        ran = [(row, body) for row, body in zip(self.rows, self.bodies, strict=True) if not row.refusal]
        lines = [[name, *(_text(row.terms[k]) for row, _ in ran)] for k, name in enumerate(self.names)]
        lines += [
            ["energy", *(_text(row.energy) for row, _ in ran)],
            [f"pressure {pressure}".strip(), *(_text(row.pressure) for row, _ in ran)],
            [f"largest force {force}".strip(), *(_text(row.largest) for row, _ in ran)],
        ]
        if len(ran) > 1:
            lines += [
                [f"forces differ by {force}".strip(), "", *(f"{row.difference:.1e}" for row, _ in ran[1:])],
                ["at", "", *(body for _, body in ran[1:])],
            ]
        title = f"{self.name} in each engine" + (f", energies in {energy}" if energy else "")
        return [(title, ["", *(row.engine for row, _ in ran)], lines)]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _text(value: float) -> str:
    return f"{value:.10g}" if np.isfinite(value) else "–"


def compare_engines(system: System, engines: Iterable[str] | None = None) -> EngineComparison:
    """Energies by term, forces and pressure of a System at its start, in kickdrift and every engine that takes it.

    The energy of a force is that of this force alone; if an engine does not take it alone, it is the energy of the
    System less that of the System without this force. Ewald's splitting depends on the other forces, so terms beside
    charges add up to the energy within Ewald's accuracy. Constraints do not count, since nothing moves.

    Parameters
    ----------
    system : a System
    engines : names of engines; default all

    Raises
    ------
    InputError
        For a Problem, an unknown engine, and a System without forces.
    """
    if not isinstance(system, System):
        raise InputError(f"compare_engines: expected a System of particles, got {type(system).__name__}")
    if not system.forces:
        raise InputError(f"compare_engines: {system.name!r} has no forces")
    chosen = [engine_named(name) for name in engines] if engines is not None else list(ENGINES.values())
    free: System = system.remade(constraints=None, events=())
    found: list[EngineForces] = []
    for engine in chosen:
        reference = next((row.forces for row in found if row.forces is not None), None)
        found.append(_of_engine(free, engine, reference))
    units = system.units
    return EngineComparison(
        system.name,
        tuple(force.name for force in system.forces),
        (units.symbol("energy"), units.symbol("pressure"), units.symbol("force")),
        tuple(system.body(row.particle) for row in found),
        tuple(found),
    )


def _of_engine(system: System, engine: Engine, reference: Floats | None) -> EngineForces:
    measured = _measured(system, engine)
    if isinstance(measured, str):
        return EngineForces(engine.name, measured)
    forces = np.ascontiguousarray((measured.accelerations * system.coherent_masses).T)
    difference, particle = 0.0, 0
    if reference is not None:
        apart = np.linalg.norm(forces - reference, axis=1)
        particle = int(apart.argmax())
        difference = float(apart[particle])
    terms = tuple(_term(system, engine, k, measured.potential) for k in range(len(system.forces)))
    largest = float(np.linalg.norm(forces, axis=1).max())
    numbers = float(measured.potential), terms, _pressure(system, measured), forces, largest, difference, particle
    return EngineForces(engine.name, "", *numbers)


def _term(system: System, engine: Engine, k: int, total: float) -> float:
    """Energy of force k alone, or that of all less that of the others where an engine needs this."""
    others = [force for i, force in enumerate(system.forces) if i != k]
    if not others:
        return float(total)
    alone = _measured(system.under([system.forces[k]]), engine)
    if not isinstance(alone, str):
        return float(alone.potential)
    rest = _measured(system.under(others), engine)
    return float("nan") if isinstance(rest, str) else float(total - rest.potential)


def _pressure(system: System, measured: Measured) -> float:
    """Pressure of this instant; nan where the box is open along an axis in which particles move."""
    if not np.isfinite(system.volume) or not all(system.box.periodic_axes[: system.dimensions]):
        return float("nan")
    v = system.state.phase[1]
    kinetic = 0.5 * float((system.coherent_masses * (v * v).sum(axis=0)).sum())
    return (2.0 * kinetic + float(measured.virial)) / (system.dimensions * system.volume)


def _measured(system: System, engine: Engine) -> Measured | str:
    """One evaluation by an engine, or the reason why it has none."""
    if not engine.foreign:
        return BoundForces(system).measure(0.0, system.state.phase) or "the forces are not finite"
    method = INTEGRATORS[next(iter(engine.motions))]
    job = Job(system, method, method.name, Options(dt=system.run.dt or DT))
    try:
        if why := engine.refusal(job):
            return why
        engine.check(job)
        session = engine.session(job)
        try:
            session.reset(system.state.phase.copy(), 0.0)
            return session.measure(0.0) or "the forces are not finite"
        finally:
            session.close()
    except (InputError, Trouble) as error:
        return str(error).removeprefix(f"engine {engine.name!r}: ")
