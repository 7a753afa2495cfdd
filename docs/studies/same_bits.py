"""Every force with every method: the same bits on 1, 2 and 4 threads, in pieces, looked at, written, resumed, restored.

A case is a system, a method and a precision. Systems cover every registered force; Lennard-Jones with each truncation,
for one species and for two; a law of the user's own; two pair forces together. Each case runs in a process that may
have four threads, and once more on one thread in another process. The short set takes each system with velocity-verlet
and each method with two systems; the long set takes all pairs that are allowed. At the end, the same comparison must
catch a planted fault: on several threads, the chunks' forces are added in the other order.
"""

import hashlib
import inspect
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.errors import InputError, KickdriftError
from kickdrift.forces import FORCES
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.pairs.ends import TRUNCATIONS
from kickdrift.forces.pairs.law import PairForce
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.integrators.method import DOUBLE, PRECISIONS
from kickdrift.jit.threads.chunks import team_of
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.example_forces import changed, charges, crystal, example, topology

STEPS, THREADS = 24, (1, 2, 4)
METHODS = [name for name, method in INTEGRATORS.items() if method.name == name]
DENSE = ("Rosenbrock", "SciPy")  # families whose Jacobians are dense
ON_ONE_THREAD = ("gravity-sheet", "tides-spin")  # sums over all pairs in one chunk, which take long for many bodies
LARGE = {f"lennard-jones {k} species, 4 chunks": k for k in (1, 2)}  # where the order of the chunks' sum shows
FAULT = (
    "forces/lists/sums.py",
    "        for c in range(chunks.number):\n            if touched",
    "        for k in range(chunks.number):\n            c = chunks.number - 1 - k if chunks.team else k\n"
    "            if touched",
)


@kd.pair_law
class Exponential(NamedTuple):
    """A law of the user's own."""

    strength: float = 1.0
    length: float = 0.5
    dimensions = {"strength": "energy", "length": "length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        r = math.sqrt(r2)
        energy = p.strength * math.exp(-r / p.length)
        return energy, energy / (p.length * r)


class Case(NamedTuple):
    """A system by name, a method, and the precision of pair forces."""

    system: str
    method: str
    precision: str = DOUBLE


def liquid(forces: list[Any], species: int = 1, edge: int = 7, periodic: bool = True, few: bool = False) -> kd.System:
    """A hot, disordered Lennard-Jones liquid of edge^3 particles in a periodic box or as a drop; 343 make two chunks of
    work, 4096 make four. Or of ``few`` particles."""
    edge = 5 if few else edge
    rng, count = np.random.default_rng(5), edge**3
    length = (count / 0.8) ** (1 / 3)
    grid = np.indices((edge, edge, edge)).reshape(3, -1).T * length / edge
    x, v = grid + rng.uniform(-0.08, 0.08, (count, 3)), 1.4 * rng.normal(size=(count, 3))
    names = ["A" if k % 3 or species == 1 else "B" for k in range(count)]
    masses, box = np.where(np.array(names) == "A", 1.0, 2.0), (length,) * 3 if periodic else None
    joined = next((found for force in forces if (found := topology(force))), None)
    charged = next((found for force in forces if (found := charges(force, count)) is not None), None)
    given = {"topology": joined, "charges": charged}
    return kd.System(x, v - v.mean(axis=0), masses, box=box, forces=forces, species=names, **given)


def disc(forces: list[Any], few: bool = False) -> kd.System:
    """A star and light planets on circles, as many as make two chunks of direct gravity, or a few."""
    count = 40 if few else 500
    r, angle = np.linspace(1.0, 6.0, count - 1)[:, None], 2.4 * np.arange(count - 1)[:, None]
    x = r * np.hstack([np.cos(angle), np.sin(angle), 0.05 * np.sin(7 * angle)])
    v = r**-0.5 * np.hstack([-np.sin(angle), np.cos(angle), 0 * angle])
    still = np.zeros((1, 3))
    masses = [1.0, *[1e-7] * (count - 1)]
    return kd.System(np.vstack([still, x]), np.vstack([still, v]), masses, forces=forces, units="nbody")


def other(name: str, few: bool) -> kd.System:
    """A registered force that is no pair law: beside gravity where it is of a central body, else in a liquid."""
    softening, few = {"softening": 0.01} if name == "gravity-tree" else {}, few or name in ON_ONE_THREAD
    near = {"point": (0.0, 0.0, -0.1)} if name == "reflecting-wall" else {}
    force = example(FORCES[name], G=1.0, **softening, **near)
    if isinstance(force, ManyBodyForce):
        return crystal(force, few)
    if force.stands_for == kd.Gravity.stands_for:
        return disc([force], few)
    if "G" in inspect.signature(FORCES[name]).parameters or name == "beside":  # unknowns go with gravity alone
        return disc([kd.Gravity(G=1.0), force], few)
    return liquid([kd.LennardJones(cutoff=2.5), force], periodic=False, few=few)


@cache
def systems() -> dict[str, Callable[[bool], kd.System]]:
    """What makes each system, by its name, with few particles or many."""
    found: dict[str, Callable[[bool], kd.System]] = {}
    for name, cls in FORCES.items():
        if not cls.__module__.startswith("kickdrift."):
            continue  # the law below, which has a case of its own
        if not issubclass(cls, PairForce):
            found[name] = lambda few, name=name: other(name, few)
            continue
        if cls is not kd.LennardJones:
            own = {"pairs": {("A", "B"): changed(cls.law_keys[0], 0.8)}}  # laws mix only epsilon and sigma
            found[name] = lambda few, cls=cls, own=own: liquid([example(cls, cutoff=2.5, **own)], 2, few=few)
            continue
        for truncation in TRUNCATIONS:
            for species in (1, 2):

                def make(few, truncation=truncation, species=species) -> kd.System:
                    sizes = {"A": {}, "B": {"sigma": 0.9, "epsilon": 0.7}}
                    mixture = {"species": sizes} if species == 2 else {}
                    return liquid([kd.LennardJones(cutoff=2.5, truncation=truncation, **mixture)], species, few=few)

                found[f"{name} {truncation} {species} species"] = make
    ends = {"A": {}, "B": {"cutoff": 1.8, "truncation": "switch"}}
    between = {("A", "B"): {"cutoff": 2.2, "truncation": "force-shift"}}
    apart = {"cutoff": 2.5, "truncation": "shift", "species": ends, "pairs": between}
    found["lennard-jones with cutoffs of pairs"] = lambda few: liquid([kd.LennardJones(**apart)], 2, few=few)
    found["a law of the user's own"] = lambda few: liquid([Exponential(cutoff=2.2)], few=few)
    found["two pair forces"] = lambda few: liquid([kd.LennardJones(cutoff=2.5), Exponential(cutoff=2.2)], few=few)
    of_two = kd.LennardJones(cutoff=2.5, species={"A": {}, "B": {"sigma": 0.9}})
    found["coulomb ewald"] = lambda few: liquid([of_two, kd.Coulomb()], 2, few=few)
    found["coulomb ewald alone"] = lambda few: liquid([kd.Coulomb(accuracy=1e-3)], few=few)
    for name, species in LARGE.items():
        mixture = {"species": {"A": {}, "B": {"sigma": 0.9}}} if species == 2 else {}
        found[name] = lambda few, k=species, mixture=mixture: liquid([kd.LennardJones(cutoff=2.5, **mixture)], k, 16)
    return found


def system_of(case: Case) -> kd.System:
    """The case's system; of few particles for methods that solve for all unknowns at once."""
    return systems()[case.system](integrator(case.method).family in DENSE)


def simulation(case: Case, threads: int = 1) -> kd.Simulation:
    """The case at its start; an InputError where the method does not take it."""
    method, system = integrator(case.method), system_of(case)
    dt = 0.02 if system.units.name == "nbody" else 0.002
    if "iteration" in method.tunable:  # fixed-point iteration in a hot liquid converges for short steps alone
        dt *= 0.25
    if case.method == "brownian":  # whose steps in a hot liquid are long
        dt *= 0.05
    options: dict[str, Any] = {"dt": dt} if method.needs_dt else {}
    wanted = {"rtol": 1e-6, "temperature": 1.0, "friction": 1.0, "tau": 1.0, "collision_rate": 1.0}
    options |= {key: value for key, value in wanted.items() if key in method.tunable}
    return kd.Simulation(system, case.method, threads=threads, precision=case.precision, **options)


def cases(long: bool) -> list[Case]:
    """All pairs of a system and a method, in each precision; or each system with velocity-verlet (and rk4, where that
    refuses a force), and each method with gravity, a liquid and another system. A method may refuse a system."""
    names = [name for name in systems() if name not in LARGE]
    chosen = {(names[5 * k % len(names)], method) for k, method in enumerate(METHODS)}
    chosen |= {(name, "velocity-verlet") for name in names} | {("hill", "sei")}
    chosen |= {(name, method) for name in ("gravity", "lennard-jones cut 1 species") for method in METHODS}
    chosen |= {(name, "rk4") for name in names if name in FORCES}  # velocity-verlet refuses forces of velocities
    every = {(name, method) for name in names for method in METHODS}
    listed = [*sorted(every if long else chosen), *((name, "velocity-verlet") for name in LARGE)]
    return [Case(*pair, each) for pair in listed for each in PRECISIONS if each == DOUBLE or has_pairs(pair[0])]


@cache
def has_pairs(name: str) -> bool:
    """Whether a system has pair forces without charges, which come in two precisions."""
    system = systems()[name](True)
    tables = any(isinstance(force, kd.Tabulated) for force in system.forces)  # which float32 cannot hold
    return system.charges is None and not tables and any(isinstance(force, PairForce) for force in system.forces)


def bits(sim: kd.Simulation) -> str:
    """A short hash of the state's bits."""
    state = sim.state
    return hashlib.sha256(state.phase.tobytes() + state.masses.tobytes()).hexdigest()[:16]


def plain(case: Case, threads: int) -> str:
    """One run, looked at where it begins and ends."""
    sim = simulation(case, threads)
    sim.run(STEPS, every=STEPS)
    return bits(sim)


def in_pieces(case: Case) -> str:
    sim = simulation(case, 2)
    for steps in (1, 7, STEPS - 8):
        sim.run(steps)
    return bits(sim)


def looked_at(case: Case) -> str:
    def look(sim: kd.Simulation) -> None:
        sim.energy()
        sim.forces()
        sim.checkpoint()

    sim = simulation(case, 4)
    sim.run(STEPS, every=5, observe=look)
    return bits(sim)


def written_and_resumed(case: Case) -> tuple[str, str]:
    """A run that is written, and its second half from the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5md"
        sim = simulation(case, 2)
        sim.run(STEPS, every=4, output=path)
        again = kd.resume(path, step=STEPS // 2, threads=1, system=system_of(case))
        again.run(STEPS - STEPS // 2)
        return bits(sim), bits(again)


def restored(case: Case) -> str:
    """The second half from a checkpoint, in a Simulation that has never run."""
    whole, other = simulation(case, 4), simulation(case, 1)
    whole.run(STEPS // 2)
    other.restore(whole.checkpoint())
    other.run(STEPS - STEPS // 2)
    return bits(other)


def histories(case: Case) -> dict[str, str]:
    """The bits at the end, by the way that led there."""
    written, resumed = written_and_resumed(case)
    return {
        **{f"{k} threads": plain(case, k) for k in THREADS},
        "in pieces": in_pieces(case),
        "looked at": looked_at(case),
        "written": written,
        "resumed": resumed,
        "restored": restored(case),
    }


def elsewhere(cases: list[Case], ways: str, path: str | None = None) -> list[Any]:
    """What `histories` or ``plain`` on one thread give in another process, which may have four threads; of the packages
    on ``path``, a PYTHONPATH, if given."""
    threads = {"NUMBA_NUM_THREADS": "4"}
    env = {**os.environ, **threads, **({"PYTHONPATH": path} if path else {})}
    # Of a module with a name, the code of its law stays on disk for the next process.
    command = [sys.executable, "-c", f"from docs.studies import same_bits; same_bits.child({ways!r})"]
    top = Path(__file__).parents[2]
    done = subprocess.run(
        command, input=json.dumps(cases), env=env, cwd=top, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return json.loads(done.stdout)


def child(ways: str) -> None:
    """Answer `elsewhere`: null for a case that the method refuses; of one that fails, why."""
    for threads in THREADS:
        team_of(threads).insist()  # threads are at work at the same time also where cores are busy
    found: list[Any] = []
    for case in (Case(*each) for each in json.load(sys.stdin)):
        try:
            simulation(case)
        except InputError:
            found.append(None)
            continue
        try:
            found.append(histories(case) if ways == "histories" else plain(case, 1))
        except KickdriftError as error:
            found.append({str(error): ""} if ways == "histories" else None)
    json.dump(found, sys.stdout)


def compared(listed: list[Case]) -> tuple[list[Case], list[str]]:
    """The cases that methods took, and those without the same bits in every way, with the ways that differ."""
    taken, apart = [], []
    all_ways = elsewhere(listed, "histories")
    on_one_thread = elsewhere(listed, "plain")  # afterwards: the machine code is then on disk
    for case, ways, alone in zip(listed, all_ways, on_one_thread, strict=True):
        if ways is None:
            continue
        taken.append(case)
        if differ := [way for way, end in ways.items() if end != alone]:
            apart.append(f"{case.system}, {case.method}, {case.precision}: {', '.join(differ)}")
    return taken, apart


def caught() -> list[str]:
    """The systems for which the planted fault changes bits between thread counts."""
    from kickdrift_validation.faults import Fault, copied

    large = [Case(name, "velocity-verlet") for name in LARGE]
    with tempfile.TemporaryDirectory() as folder:
        fault = Fault("chunk-order", "the chunks' forces added in the other order on threads", *FAULT)
        ways = elsewhere(large, "histories", copied(Path(folder), fault))
    return [case.system for case, each in zip(large, ways, strict=True) if len(set(each.values())) > 1]


def claims(long: bool = False) -> Iterator[Claim]:
    taken, apart = compared(cases(long))
    own = "one thread in another process"
    text = f"{len(taken)} cases of a system, a method and a precision have the same bits in {len(THREADS) + 5} ways"
    yield claim(text, "; ".join(apart[:5]) or "all", "all", not apart, own)
    missing = (set(METHODS) | set(systems())) - {case.method for case in taken} - {case.system for case in taken}
    yield claim("every method and every system is among them", ", ".join(missing) or "all", "all", not missing, own)
    found = caught()
    fault = "the chunks' forces added in the other order on threads are noticed, for one species and for two"
    yield claim(fault, ", ".join(found), "both", found == list(LARGE), "a planted fault")


if __name__ == "__main__":
    main(claims, __doc__)
