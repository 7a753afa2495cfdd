"""Report of a run: conservation of energy and momentum, and cost."""

from __future__ import annotations

import math
import os
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.outputs import plain
from kickdrift.display.showing import above
from kickdrift.engines import NATIVE
from kickdrift.forces.seam.group import ListedForce
from kickdrift.integrators.options import PRESSURE, RAMPED, TEMPERATURE, mean_pressure
from kickdrift.looks.observers import NOTHING
from kickdrift.looks.record import BOTH, LOOKS, OBSERVING, STEPPING, WRITING, Record, Series, even_looks
from kickdrift.model.checks.values import unwarned
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.run.report.charges import ChargeReport, charge_report
from kickdrift.run.report.energy import EnergyReport, energy_report, work_of, working
from kickdrift.run.report.hits import HitReport, hit_report
from kickdrift.run.report.molecules import MoleculeReport, molecule_report
from kickdrift.run.report.pairs import PairReport, pair_report
from kickdrift.run.report.shown import ShownReport
from kickdrift.run.report.tensor import TensorReport, tensor_report
from kickdrift.run.report.warnings import DIFFERS, DRAWN, SLOW, cause_of_drift, ends_badly, melting, moving, verdict
from kickdrift.statistics.blocks import block_average
from kickdrift.text import measured

COMPILING = "compiling"
DERIVED = ("temperature_error", "pressure_error", "volume_error", "temperature_verdict", "pressure_verdict")


class About(NamedTuple):
    """Facts that a Report needs beside its own numbers, to print and draw itself.

    Attributes
    ----------
    units : UnitSystem; None for a Problem
    dimensions : of the particles' space
    series : the samples
    even : whether the samples are equally many steps apart, except perhaps at the ends
    bath : whether a heat bath acted
    output : path of the run's file, "" if none was written
    cause : words on the likely cause of a secular drift
    drawn : whether the bath alone makes the velocities, so that the temperature says nothing about the run
    slow : whether the method's velocities are too slow by an error of the step that its configurations do not have
    """

    units: UnitSystem | None
    dimensions: int
    series: Series
    even: bool = True
    bath: bool = False
    output: str = ""
    cause: str = ""
    drawn: bool = False
    slow: bool = False


@dataclass(frozen=True, repr=False)
class Report(ShownReport):
    """A run's summary. Values that do not exist for a Problem are None.

    ``print(report)`` shows the lines that the command line prints, ``as_json()`` returns what ``--json`` writes, and
    ``plot()`` draws the energies, their error and the temperature.

    ``momentum_error`` is the largest |P(t) - P(0)| over the samples divided by the sum of m |v| at the start. It is
    None in an external field. ``angular_momentum_error`` is the same with m |x × v|, and also None in a periodic box,
    which does not conserve angular momentum. ``temperature`` and ``pressure`` are means over the samples, in the
    system's units; None where they are undefined. ``temperature_error`` and ``pressure_error`` are their standard
    errors, see ``statistics.blocks``; None if the run is too short for its correlations. ``temperature_verdict``
    compares the mean temperature with the temperature of a heat bath: "agrees" within three standard errors, else
    "differs by 4.1 standard errors", or "too short to judge"; None without a heat bath. The verdict says so where the
    velocities alone may be too slow, as those of ``baoab`` are in a long step. ``pressure_verdict`` does the same with
    the pressure of a barostat. ``volume`` and ``volume_error`` are those of a box that a barostat changes, else None.
    ``tensor`` has the components of the pressure, where the barostat changes the shape of the box. ``hits`` counts
    those of hard spheres under ``event-driven``; the pressure is then that of motion and hits between two looks.
    ``pairs`` counts the pairs that ``hermite4`` regularises.
    ``heat`` is the energy that the bath gave, and ``work`` the energy that the change of the box gave; None without
    bath or barostat, and if the engine does not tell them. ``options`` holds the options except dt and tolerances.
    ``wall_seconds`` is the time of steps and looks, ``compile_seconds`` that of compiling, or of loading compiled code
    from the disk. ``seconds`` tells how the time was spent: "stepping", "looks", "writing", "observing" (``observe``
    and the user's columns) and "compiling". "looks" is None if compiled code takes looks between its steps: "stepping"
    includes them then. ``ns_per_pair`` is the wall time per force evaluation and pair within range; None without a pair
    list.

    ``events`` holds `Simulation.events` and the close approaches that have not ended. ``energy_taken`` is the energy
    that collisions and removed bodies took out, None without such events; the energy's error excludes it.
    ``angular_momentum_taken`` (3 numbers) is the angular momentum that went from orbits into spins, and that of removed
    bodies. ``stopped``
    names the event that ended the run, "" if none did. ``equilibrated`` tells how the run was equilibrated before its
    record began, "" if it was not. ``fixed`` tells how many particles are fixed, "" if none is.
    """

    system: str
    engine: str
    engine_version: str | None
    integrator: str
    particles: int | None
    units: str | None
    dt: float | None
    rtol: float | None
    atol: float | None
    options: dict[str, Any]
    steps: int
    rejected_steps: int
    time: float
    seed: int | None
    threads: int
    processes: int
    samples: int
    force_evaluations: int | None
    jacobian_evaluations: int
    wall_seconds: float
    compile_seconds: float
    seconds: dict[str, float | None]
    steps_per_second: float
    ns_per_pair: float | None
    energy: EnergyReport | None
    momentum_error: float | None
    angular_momentum_error: float | None
    temperature: float | None
    pressure: float | None
    y: list[float] | None
    events: list[dict[str, Any]]
    energy_taken: float | None
    angular_momentum_taken: list[float] | None
    stopped: str
    heat: float | None
    work: float | None
    volume: float | None
    warnings: list[str]
    about: About = field(compare=False)
    charges: ChargeReport | None = None
    equilibrated: str = ""
    fixed: str = ""
    molecules: MoleculeReport | None = None
    tensor: TensorReport | None = None
    hits: HitReport | None = None
    pairs: PairReport | None = None

    @cached_property
    def temperature_error(self) -> float | None:
        """Standard error of the mean temperature; None if it is undefined or the run is too short."""
        return self.error_of(self.about.series.temperatures)

    @cached_property
    def pressure_error(self) -> float | None:
        """Standard error of the mean pressure; None if it is undefined or the run is too short."""
        return self.error_of(self.about.series.pressures)

    @cached_property
    def volume_error(self) -> float | None:
        """Standard error of the mean volume; None without a barostat or if the run is too short."""
        return self.error_of(self.about.series.volumes)

    @property
    def temperature_verdict(self) -> str | None:
        """The mean temperature beside the temperature of the heat bath, in words; None without a bath.

        Motion without inertia has no velocities of its own: the bath draws the velocities, and nothing is judged."""
        if not self.about.bath or self.temperature is None:
            return None
        if self.about.drawn:
            return DRAWN
        if (ramp := self._ramp(TEMPERATURE.name)) is not None:
            return ramp
        asked = self.options[TEMPERATURE.name]
        found = verdict(self.temperature, self.temperature_error, asked)
        slow = self.about.slow and found.startswith(DIFFERS) and self.temperature < asked
        return f"{found}; {SLOW}" if slow else found

    @property
    def pressure_verdict(self) -> str | None:
        """The mean pressure beside the pressure of the barostat, in words; None without a barostat."""
        if self.volume is None or self.pressure is None:
            return None
        if (ramp := self._ramp(PRESSURE.name)) is not None:
            return ramp
        return verdict(self.pressure, self.pressure_error, mean_pressure(self.options))

    def _ramp(self, name: str) -> str | None:
        """A ramp of an option in words; None without one."""
        end, units = self.options.get(RAMPED[name]), self.about.units
        if end is None or units is None:
            return None
        return f"the start of a ramp to {measured(f'{end:g}', units.symbol(name))}"

    def error_of(self, values: Floats | None) -> float | None:
        """Standard error of the mean over samples (k,); None if they are undefined or the run is too short."""
        if values is None:
            return None
        if self.about.even:
            series = self.about.series
            values = values[even_looks(series.steps, series.times)]
        values = values[np.isfinite(values)]
        error = float(block_average(values).error)
        return error if np.isfinite(error) else None

    def plot(self) -> Any:
        """Draw energies, energy error and temperature at the samples; a matplotlib Figure.

        A Problem has its energy error alone. Frames, for orbits and structure, are in the run's file: see
        ``kd.open(path).plot()``. An InputError for a Problem without an energy function."""
        return above("report figure")(self)

    def as_json(self) -> dict[str, Any]:
        """Return the report as plain numbers, texts and Nones; infinities and nan become None."""
        own = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "about"}
        own |= {name: getattr(self, name) for name in DERIVED}
        parts: dict[str, Any] = {
            "energy": self.energy and asdict(self.energy),
            "charges": self.charges and asdict(self.charges),
        }
        parts |= {"molecules": self.molecules and asdict(self.molecules), "tensor": self.tensor and asdict(self.tensor)}
        parts |= {"hits": self.hits and asdict(self.hits), "pairs": self.pairs and asdict(self.pairs)}
        return plain(own | parts)

    def written_to(self, output: str | os.PathLike[str] | None) -> Report:
        """Return the same report, with the file that the run wrote."""
        return self if output is None else replace(self, about=self.about._replace(output=os.fspath(output)))


@unwarned
def report(sim: Any) -> Report:
    """Return the report of a Simulation, or of one system in a Batch, so far."""
    record, system = sim.record, sim.system
    series = record.series()
    of_particles, bath, even = isinstance(system, System), sim.method.bath, not sim.method.chooses_steps
    told = record.taken is not NOTHING  # whether energy that has left is known
    counted = sim.engine == NATIVE or sim.method.evaluations > 0  # another program has counted its own evaluations
    listed = isinstance(system, System) and any(isinstance(force, ListedForce) for force in system.forces)
    work = record.force_evaluations * (series.pairs or 0.0) if listed else 0.0
    fresh = listed and isinstance(system, System) and record.from_start
    melted = melting(system, series.temperatures, sim, bath) if fresh and isinstance(system, System) else []
    moved = moving(system, sim.method.drags, series) if isinstance(system, System) else []
    unknown = "" if told or not bath else f"not judged: {sim.engine} does not tell the heat"
    work_given = work_of(system, record.samples) if working(system) else None
    energy, doubt = energy_report(series, even, system, bath, unknown, work_given)
    doubts = [line for line in (doubt, *ends_badly(system, sim.state)) if line and line not in record.warnings]
    options = sim.options.extras(sim.method.tunable)
    rtol, atol = options.pop("rtol", None), options.pop("atol", None)
    return Report(
        system=system.name,
        engine=sim.engine,
        engine_version=sim.engine_version,
        integrator=sim.integrator,
        particles=len(system) if of_particles else None,
        units=system.units.name if isinstance(system, System) else None,
        dt=None if sim.method.adaptive else sim.dt,
        rtol=rtol,
        atol=atol,
        options=options,
        steps=record.steps,
        rejected_steps=record.rejected_steps,
        time=float(series.times[-1] - series.times[0]) if sim.method.chooses_steps else _length(record, sim.dt or 0.0),
        seed=system.seed if isinstance(system, System) else None,
        threads=sim.threads,
        processes=sim.processes,
        samples=len(series.steps),
        force_evaluations=record.force_evaluations if counted else None,
        jacobian_evaluations=record.jacobian_evaluations,
        wall_seconds=record.wall_seconds,
        compile_seconds=record.compile_seconds,
        seconds=seconds_of(record),
        steps_per_second=record.steps / record.wall_seconds if record.wall_seconds else 0.0,
        ns_per_pair=1e9 * record.wall_seconds / work if work else None,
        energy=energy,
        momentum_error=None
        if sim.method.drags or (isinstance(system, System) and system.acting("external"))
        else _largest_change(series.momentum, record.momentum_scale),
        angular_momentum_error=None
        if sim.method.drags or (isinstance(system, System) and (system.box.periodic or system.acting("external")))
        else _largest_change(series.angular_momentum, record.angular_momentum_scale),
        temperature=_finite(series.temperature) if of_particles else None,
        pressure=_finite(series.pressure) if of_particles else None,
        y=None if of_particles else sim.state.y.tolist(),
        events=[*sim.events, *sim.going_on()],
        energy_taken=None if bath or not told else record.taken.energy,
        angular_momentum_taken=None if bath or not told else (record.taken.angular_momentum * np.ones(3)).tolist(),
        stopped=sim.stopped,
        heat=-record.taken.energy - record.work if bath and told else None,
        work=record.work if series.volumes is not None else None,
        volume=None if series.volumes is None else float(series.volumes.mean()),
        warnings=[
            *record.warnings,
            *moved,
            *melted,
            *(line for line in doubts if line and line not in record.warnings),
        ],
        charges=charge_report(system, sim),
        equilibrated=record.equilibrated,
        fixed=str(system.fixed) if isinstance(system, System) and system.fixed is not None else "",
        molecules=molecule_report(system, sim),
        tensor=tensor_report(system, sim),
        hits=hit_report(sim),
        pairs=pair_report(sim),
        about=_about(system, series, even, bath)._replace(drawn=sim.method.overdamped, slow=sim.method.slow_velocities),
    )


def _about(system: System | Problem, series: Series, even: bool, bath: bool) -> About:
    if not isinstance(system, System):
        return About(None, 0, series, even)
    return About(system.units, system.dimensions, series, even, bath, cause=cause_of_drift(system, even))


def _length(record: Record, dt: float) -> float:
    """Length of the record in time, of fixed steps; negative for a run back in time."""
    length = record.steps * dt - record.unfinished
    return -length if record.backward else length


def seconds_of(record: Record) -> dict[str, float | None]:
    """Return the seconds of each part of the work; see `Report`."""
    stepping, looks, both = (record.spent.get(part, 0.0) for part in (STEPPING, LOOKS, BOTH))
    return {
        STEPPING: stepping + looks + both if both else stepping,
        LOOKS: None if both else looks,
        WRITING: record.spent.get(WRITING, 0.0),
        OBSERVING: record.spent.get(OBSERVING, 0.0),
        COMPILING: record.compile_seconds,
    }


def _largest_change(values: Floats | None, scale: float) -> float | None:
    """Return the largest change of a vector (k, 3) since the first sample, over ``scale`` unless 0."""
    if values is None:
        return None
    change = values - values[0]
    largest = math.sqrt(float(np.einsum("ij,ij->i", change, change).max()))
    return largest / scale if scale else largest


def _finite(mean: float) -> float | None:
    return mean if np.isfinite(mean) else None
