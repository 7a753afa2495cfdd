"""What do other forces do inside the encounters and passages of trace, and what do kicks alone miss there?

A giant that passes at 0.1 au from its star under a strong quadrupole or strong relativity (c = 300 in place of 10065 au
per year over 2 pi), a massless comet under real relativity, and a massless moon of a flattened giant. "As kicks" is the
same map with all other forces at both ends of each step, as rebound's TRACE has them in encounters. The references are
gauss-radau15 and the closed form of the pericentre's advance, 6 pi G M / (c^2 a (1 - e^2)) (Einstein 1915).
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, main
from kickdrift_validation.trace import diver, on_orbits

C = 10065.32  # au per year over 2 pi
STRONG = {
    "J2": kd.Oblateness(j2=0.01, radius=0.1),
    "1PN": kd.PostNewtonian(c=300.0),
    "1PN potential": kd.PostNewtonian(c=300.0, form="potential"),
}


def moon(*forces: Any) -> kd.System:
    """A massless moon that circles a giant in 2.2."""
    x = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [5.05, 0.0, 0.01]]
    v = [[0.0, 0.0, 0.0], [0.0, 0.45, 0.0], [0.0, 0.59, 0.02]]
    return kd.System(x, v, masses=[1.0, 1e-3, 0.0], forces=[kd.Gravity(), *forces], units="nbody")


def run(system: kd.System, dt: float, time: float, kicks: bool = False) -> kd.Simulation:
    """A run of trace, if asked with all other forces as kicks."""
    sim = kd.Simulation(system, "trace", dt=dt)
    if kicks:
        hybrid = sim.integration.stepper._hybrid  # type: ignore[union-attr]
        hybrid.groups[:], hybrid.present[:] = 0, (1, 0)
    sim.run(until=time)
    return sim


def distance(sim: kd.Simulation, exact: kd.Simulation) -> float:
    """Largest distance between the bodies of two runs."""
    return float(np.abs(sim.state.positions - exact.state.positions).max())


def exactly(system: kd.System, time: float) -> kd.Simulation:
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(until=time)
    return sim


def close_passages() -> Iterator[Claim]:
    """Two passages at 0.1 au, with and without the force inside."""
    steps, alone = (2.0, 1.0, 0.5), exactly(diver(), 100.0)
    usual = max(distance(run(diver(), dt, 100.0), alone) for dt in steps)
    for name, force in STRONG.items():
        exact = exactly(diver(force), 100.0)
        start, far, energies = exact.energy().total, [], []
        for kicks in (False, True):
            sims = [run(diver(force), dt, 100.0, kicks) for dt in steps]
            far.append(max(distance(sim, exact) for sim in sims))
            energies.append(max(abs(sim.energy().total / start - 1.0) for sim in sims))
        text = f"passages at 0.1 au under {name}, dt = 2, 1, 0.5: largest distance from gauss-radau15"
        note = f"gravity alone {usual:.1e}; as kicks {far[1]:.1e}; energy {energies[0]:.1e}, as kicks {energies[1]:.1e}"
        yield claim(text, far[0], "at most three times that of gravity alone", far[0] <= 3.0 * usual, note)


def long_steps() -> Iterator[Claim]:
    """Steps so long that all bodies are always in passage."""
    for name, force in STRONG.items():
        system = on_orbits([(1e-3, 5.0, 0.3, 0.1, 0.0, 0.0, np.pi), (2e-3, 5.8, 0.1, 0.0, 0.0, 0.0, 1.0)])
        system = system.with_forces(kd.Gravity(), force)
        found = distance(run(system, 30.0, 300.0), exactly(system, 300.0))
        text = f"two giants under {name}, each step one passage: distance from gauss-radau15 after ten steps"
        yield at_most(text, found, 1e-11, "no error of a splitting is left")


def moon_of_a_flattened_giant() -> Claim:
    flat = kd.Oblateness(j2=0.1, radius=0.02, central=1)
    exact, alone = exactly(moon(flat), 8.0), exactly(moon(), 8.0)
    usual, found = distance(run(moon(), 4.0, 8.0), alone), distance(run(moon(flat), 4.0, 8.0), exact)
    kicked = distance(run(moon(flat), 4.0, 8.0, True), exact)
    text = "massless moon of a flattened giant, dt = 1.8 turns: distance from gauss-radau15"
    note = f"gravity alone {usual:.1e}; as kicks {kicked:.1e}"
    return claim(text, found, "at most 1.1 times that of gravity alone", found <= 1.1 * usual, note)


def advance() -> Claim:
    """Pericentre of a massless comet after 20 turns."""
    a, e, turns = 5.0, 0.98, 20
    expected = turns * 6.0 * np.pi / (C**2 * a * (1.0 - e * e))
    period, found = 2.0 * np.pi * a**1.5, []
    for kicks in (False, True):
        system = on_orbits([(0.0, a, e, 0.0, 0.0, 0.0, np.pi)]).with_forces(kd.Gravity(), kd.PostNewtonian(c=C))
        state = run(system, period / 40.0, turns * period, kicks).state
        x, v = (each[1] - each[0] for each in (state.positions, state.velocities))
        vector = np.cross(v, np.cross(x, v)) - x / np.linalg.norm(x)  # points at the pericentre
        found.append(abs(float(np.arctan2(vector[1], vector[0])) / expected - 1.0))
    text = "comet with q = 0.1 au, 40 steps a turn: advance of its pericentre in 20 turns, relative to the closed form"
    return claim(text, found[0], "at most 1e-3", found[0] <= 1e-3, f"{expected:.3e} rad; error as kicks {found[1]:.1e}")


def way_back() -> Iterator[Claim]:
    """Steps there and back, with passages."""
    for name, force in STRONG.items():
        system = diver(force)
        there = run(system, 2.0, 120.0).state
        m = there.masses
        turned = kd.System(there.positions, -there.velocities, masses=m, forces=system.forces, units="nbody")
        error = float(np.abs(run(turned, 2.0, 120.0).state.positions - system.state.positions).max())
        yield at_most(f"passages at 0.1 au under {name}: 60 steps there and back", error, 1e-11, "the start")


def claims(long: bool = False) -> Iterator[Claim]:
    yield from close_passages()
    yield from long_steps()
    yield moon_of_a_flattened_giant()
    yield advance()
    yield from way_back()


if __name__ == "__main__":
    main(claims, __doc__)
