"""Conversion between rebound's Simulation and a System: bodies, G, units, and the method if both programs have it.

A Simulation without units becomes ``nbody``. AU, yr and Msun become ``astro``; m, s and kg become ``si``. Other units
keep their names in a reduced unit system. G is always the Simulation's own, to the bit: rebound's
39.4769264214 au^3/(msun yr^2) exceeds the G of ``astro`` by 7.5e-12, relative.

rebound reads an archive in a process of its own, because a damaged archive may end that process. A run's frames become
the snapshots of an archive.
"""

import errno
import json
import math
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterable
from pathlib import Path
from threading import Timer
from typing import Any, NamedTuple

import numpy as np
import rebound
from pydantic import TypeAdapter
from rebound.units import lengths_SI, masses_SI, times_SI

from kickdrift.bridges import rebound_snapshot, rebound_system
from kickdrift.bridges.rebound_snapshot import CHOICES, COLUMNS, OPTIONS, Snapshot, described
from kickdrift.disk.files import shown_path
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, Hill
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.integrators.options import HILL_RADII, INNER, JACOBI, PERICENTRE, STANDARD
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import shown

CLOCK_SECONDS, CLOCK_RATE = 60, 10**6  # limit by the clock: this, and the file's size at so many bytes a second
ANSWER_BYTES, ANSWER_SHARE = 2**20, 4  # most of an answer: this, and this many times the file's size
POINTERS = "reset function pointers"  # in rebound's warning about functions that no archive holds
OTHER_COUNT = "Number of particles found does not match"  # in its warning about a snapshot that is not whole
TRACE = (HILL_RADII, PERICENTRE, INNER)


class Told(NamedTuple):
    """Answer of the process: the number of snapshots, rebound's warnings, and one snapshot; or an error."""

    snapshots: int = 0
    said: tuple[str, ...] = ()
    snapshot: Snapshot | None = None
    error: str = ""


def archived_system(path: Path, snapshot: int | None = None) -> System:
    """Return the System of a snapshot, by default the last, named after the file; see ``kickdrift.load``."""
    snapshot = -1 if snapshot is None else snapshot
    if isinstance(snapshot, bool) or not isinstance(snapshot, int | np.integer):
        raise InputError(f"snapshot: expected a whole number, got {shown(snapshot)}")
    told, table = _told(path, int(snapshot))
    count, found, said = told.snapshots, told.snapshot, told.said
    if found is None:
        raise InputError(f"{path}: has no snapshot {snapshot}; the archive holds {count}, from 0 to {count - 1}")
    if any(OTHER_COUNT in each for each in said):
        raise _damaged(path, "a snapshot lacks particles")
    if any("corrupt" in each for each in said):
        warnings.warn(f"{path}: the end of the archive is damaged; its {count} whole snapshots are read", stacklevel=4)
    lost = ["additional forces and other functions, which no archive holds"] if any(POINTERS in s for s in said) else []
    if found.collision != "none":
        lost.append(f"the action on collisions ({shown(found.collision)}); give the run events=[kd.Collision(…)]")
    try:
        system = rebound_system.system_from(found._replace(collision="none"), table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if lost:
        warnings.warn(f"{path}: left out: {'; '.join(lost)}", stacklevel=4)
    return system.remade(name=path.stem)


def snapshots_in(path: Path) -> int:
    """Number of an archive's whole snapshots."""
    return _told(path, None)[0].snapshots


def _told(path: Path, snapshot: int | None) -> tuple[Told, Floats]:
    """Answer of the process, and the table (bodies, columns) of the snapshot's bodies."""
    head, _, data = _answer(path, snapshot).partition(b"\n")
    try:
        told = TypeAdapter(Told).validate_json(head)
    except ValueError:
        raise _damaged(path, "its settings make no sense") from None
    if told.error:
        raise InputError(f"{shown_path(path)}: rebound cannot read this archive: {' '.join(told.error.split())}")
    bodies = told.snapshot.N if told.snapshot else 0
    if told.snapshot and not _whole(told.snapshot):
        raise _damaged(path, "its settings make no sense")
    if len(data) != 8 * len(COLUMNS) * bodies:
        raise _damaged(path, "a snapshot lacks particles")
    return told, np.frombuffer(data).reshape(len(COLUMNS), bodies).T


def _whole(found: Snapshot) -> bool:
    """Whether a snapshot has its method's options, numbers and words, and a name for each body or for none."""
    options = {key: key in CHOICES for key in OPTIONS.get(found.integrator, ())}
    return options == {key: isinstance(value, str) for key, value in found.options.items()} and (
        len(found.names) in (0, found.N)
    )


def _answer(path: Path, snapshot: int | None) -> bytes:
    """Run `rebound_snapshot` on the archive, and return its answer. Raises InputError if it dies or takes too long."""
    size = os.stat(path).st_size
    most, clock = ANSWER_BYTES + ANSWER_SHARE * size, Timer(CLOCK_SECONDS + size / CLOCK_RATE, lambda: process.kill())
    words = json.dumps([str(path), snapshot, [each for each in sys.path if each and isinstance(each, str)]])
    process: Any
    with subprocess.Popen(
        [sys.executable, "-I", rebound_snapshot.__file__, words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, env=os.environ | {"OMP_NUM_THREADS": "1"},
    ) as process:  # fmt: skip
        clock.start()
        try:
            answer: bytes = process.stdout.read(most + 1)
            if len(answer) > most:
                process.kill()
            process.wait()
        except BaseException:
            process.kill()
            raise
        finally:
            clock.cancel()
    if not answer or process.returncode:
        raise _damaged(path, _end(process.returncode))
    return answer


def _end(status: int) -> str:
    """How the process ended, in words."""
    if status in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)):
        return "rebound takes too much time or memory"
    try:
        return f"rebound ended with {signal.Signals(-status).name}"
    except ValueError:
        return f"rebound ended with status {status}"


def _damaged(path: Path, how: str) -> InputError:
    return InputError(f"{shown_path(path)}: rebound cannot read this archive, so it is damaged: {how}")


def system_of(sim: Any, forces: Iterable[Any] | None = None) -> System:
    """Return a System; see `System.from_rebound`."""
    if not isinstance(sim, rebound.Simulation):
        raise InputError(f"sim: expected a rebound.Simulation, got {type(sim).__name__}")
    snapshot, table = described(sim)
    return rebound_system.system_from(snapshot, np.frombuffer(table).reshape(len(COLUMNS), -1).T, forces)


def simulation_of(system: System) -> Any:
    """Return a rebound Simulation; see `System.to_rebound`."""
    hill = [force for force in system.forces if isinstance(force, Hill)] if system.run.integrator == "sei" else []
    gravity = _gravity(system, hill)
    if system.box.periodic:
        raise InputError("to_rebound: the box is periodic; rebound's boundaries differ from kickdrift's")
    if system.fixed is not None:
        raise InputError("to_rebound: rebound moves all bodies, and this system has fixed particles")
    if system.units.coherent_mass != 1.0:
        raise InputError(f"to_rebound: rebound cannot express units {system.units.name!r}, in which force is not m a")
    sim, state = rebound.Simulation(), system.state
    if (units := _rebound_units(system.units)) is not None:
        sim.units = units
    if gravity is None:
        sim.gravity = "none"
    else:
        sim.G = gravitational_constant(gravity.name, gravity.G, system)
        sim.softening = gravity.softening
    radii = np.zeros(len(system)) if system.radii is None else system.radii
    rows = np.column_stack([state.masses, state.positions, state.velocities, radii]).tolist()
    for i, (m, x, y, z, vx, vy, vz, r) in enumerate(rows):
        name = system.names[i] if system.names and system.names[i] != rebound_system.unnamed(i) else None
        sim.add(m=m, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, r=r, name=name)
    massive = int(np.count_nonzero(state.masses))
    if massive < len(system) and state.masses[:massive].all():
        sim.N_active = massive
    sim.t = state.time
    untaken = _set_method(sim, system) + [f"event {event.kind}" for event in system.events]
    rebound_system.tell("to_rebound", untaken, 4)
    return sim


def _gravity(system: System, frame: list[Any]) -> Gravity | None:
    forces = [force for force in system.forces if force not in frame]
    strange = [force.name for force in forces if not isinstance(force, Gravity)]
    if strange:
        raise InputError(f"to_rebound: rebound has no force {strange[0]!r}; expected only gravity")
    if len(forces) > 1:
        raise InputError("to_rebound: expected one gravity force, got two")
    return forces[0] if forces else None


def _rebound_units(units: UnitSystem) -> tuple[str, str, str] | None:
    """Return rebound's names of the units of length, time and mass; None for plain numbers."""
    if units.name in rebound_system.UNITS:
        return rebound_system.UNITS[units.name]
    known = units.length in lengths_SI and units.time in times_SI and units.mass in masses_SI
    return (units.length, units.time, units.mass) if known else None


def _set_method(sim: Any, system: System) -> list[str]:
    """Set the integrator if rebound has it; return warnings about options without an equivalent."""
    run, masses = system.run, system.state.masses
    if run.dt is not None:
        sim.dt = run.dt
    central = int(np.argmax(masses)) == 0
    if run.integrator is None:
        return []
    if run.integrator == "gauss-radau15":
        sim.integrator = "ias15"
        if run.options.get("rtol") is not None:
            sim.integrator.epsilon = run.options["rtol"]
        return []
    if run.integrator == "sei":
        (hill,) = (force for force in system.forces if isinstance(force, Hill))
        sim.integrator, sim.OMEGA, sim.OMEGAZ = "sei", hill.omega, hill.vertical * abs(hill.omega)
        return []
    for order, name in rebound_system.LEAPFROGS.items():
        if run.integrator == name:
            sim.integrator = "leapfrog"
            sim.integrator.order = order
            return []
    if run.integrator == "wisdom-holman" and central:
        sim.integrator = "whfast"
        sim.integrator.coordinates = rebound_system.key_of(
            rebound_system.COORDINATES, run.options.get("coordinates", JACOBI)
        )
        sim.integrator.corrector = run.options.get("corrector", 0)
        sim.integrator.kernel = rebound_system.key_of(rebound_system.KERNELS, run.options.get("kernel", STANDARD))
        return []
    if run.integrator == "trace" and central:
        own: dict[str, Any] = {each.name: run.options.get(each.name, each.default) for each in TRACE}
        sim.integrator = "trace"
        sim.integrator.r_crit_hill = own["hill_radii"]
        sim.integrator.peri_mode = rebound_system.passage_of(own["pericentre"], own["inner"])
        if own["pericentre"] == "none":
            sim.integrator.peri_crit_eta = math.inf  # no step is longer than this times the time scale
        return []
    order_there = rebound_system.key_of(rebound_system.SABA, run.options.get("order", "10,6,4"))
    if run.integrator == "saba" and central and order_there and run.options.get("coordinates", JACOBI) == JACOBI:
        sim.integrator = "saba"
        sim.integrator.type = order_there
        return []
    return [f"integrator {run.integrator!r} as it is set here"]


class Archive:
    """An archive in the making: ``append`` adds a snapshot.

    Attributes
    ----------
    notes : what the archive does not hold, or holds in another form
    """

    def __init__(self, path: Path, system: System) -> None:
        if not str(path).isascii():
            raise InputError(f"{path}: rebound takes file names in ASCII alone")
        self.path, self.count = str(path), 0
        gravity = [force for force in system.forces if isinstance(force, Gravity)]
        self.notes = [f"force {force.name!r} is left out" for force in system.forces if not isinstance(force, Gravity)]
        if system.box.periodic:
            self.notes.append("the box is left out")
        gone: dict[str, Any] = dict.fromkeys(("equilibration", "topology", "constraints", "fixed"))
        self.system = system.remade(forces=gravity, box=Box(None), events=(), **gone)
        if system.constraints is not None:
            self.notes.append("the constraints are left out")
        if system.fixed is not None:
            self.notes.append("fixed particles are free")
        self.notes += [f"event {event.kind!r} is left out" for event in system.events]
        self._there: tuple[int, ...] | None = None
        self._sim: Any = None

    def append(self, x: Floats, v: Floats, masses: Floats, time: float, step: int) -> None:
        """Write the bodies of a frame: positions and velocities (n, 3), nan where a body is gone, and masses (n,)."""
        there = np.flatnonzero(np.isfinite(x[:, 0]))
        if (rows := tuple(there.tolist())) != self._there:
            self._sim, self._there = self._made(rows), rows
        x, v, m = (np.ascontiguousarray(each[there]) for each in (x, v, masses))
        self._sim.set_serialized_particle_data(xyz=x, vxvyvz=v, m=m)
        self._sim.t, self._sim.steps_done = time, step
        self._sim.save_to_file(self.path)
        self.count += 1

    def _made(self, rows: Iterable[int]) -> Any:
        """A Simulation of some bodies, with G, units, method and step."""
        system, chosen = self.system, list(rows)
        kept = system.remade(
            positions=system.state.positions[chosen],
            velocities=system.state.velocities[chosen],
            masses=system.state.masses[chosen],
            species=[system.species[system.species_index[k]] for k in chosen],
            names=[system.names[k] for k in chosen] if system.names else (),
            radii=None if system.radii is None else system.radii[chosen],
            ids=system.state.ids[chosen],
        )
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            sim = simulation_of(kept)
        lost = [str(each.message).rpartition(": ")[2] + " is left out" for each in said]
        self.notes += [note for note in lost if note not in self.notes]
        return sim

    def check(self) -> None:
        """Read the archive back. Raises OSError if snapshots are missing: rebound does not tell of a full disk."""
        try:
            found = snapshots_in(Path(self.path))
        except InputError:
            found = 0
        if found != self.count:
            raise OSError(errno.ENOSPC, f"{found} of {self.count} snapshots were written")
