"""Walls, position restraints and traps: beside harmonic solutions, straight lines that fold, and LAMMPS.

Restrained particles and a particle at a soft wall have closed solutions, from which velocity Verlet differs by its
error of order two. Free particles between hard walls are where straight lines fold, for any step. A liquid between hard
walls goes back to its start. A trap and a restraint in a periodic box do not change when a particle moves by
whole edges. The virial of a restraint is the slope of its energy with the box.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, main

EDGE, LEANING = 4.0, np.array([[5.0, 0.0, 0.0], [2.0, 5.0, 0.0], [-1.5, 2.2, 5.5]])
LINES, CLOSED = "straight lines that fold", "the harmonic oscillator"


def room(edge: float = EDGE) -> list[Any]:
    """Six hard walls around a cube."""
    ways = [(tuple(sign * row), tuple(np.full(3, 0.5 * edge * (1 - sign)))) for row in np.eye(3) for sign in (1, -1)]
    return [kd.ReflectingWall(normal, point) for normal, point in ways]


def folded(x: np.ndarray, edge: float = EDGE) -> np.ndarray:
    """Places in a cube of mirrors of particles that fly straight."""
    return edge - np.abs(np.mod(x, 2 * edge) - edge)


def wedge() -> tuple[kd.System, np.ndarray]:
    """Three particles between two hard walls at 50 degrees, and the normals of the walls."""
    angle = np.radians(50.0)
    normals = np.array([[0.0, 1.0, 0.0], [np.sin(angle), -np.cos(angle), 0.0]])
    x = [[2.0, 0.4, 0.0], [3.0, 1.0, 0.0], [1.5, 1.0, 0.0]]
    v = [[-1.0, 0.3, 0.1], [-2.0, -0.2, 0.0], [-1.0, -2.0, 0.2]]
    return kd.System(x, v, forces=[kd.ReflectingWall(tuple(row)) for row in normals.tolist()]), normals


def bounced(system: kd.System, normals: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Places and velocities of free particles after a time, bounce by bounce, and the number of bounces."""
    x, v, bounces = system.state.positions.copy(), system.state.velocities.copy(), 0
    for place, speed in zip(x, v, strict=True):
        left = time
        while True:
            rates, s = normals @ speed, normals @ place
            times = np.where(rates < 0, -s / np.where(rates < 0, rates, 1.0), np.inf)
            times[times < 1e-12] = np.inf  # the wall that the particle has just left
            k = int(times.argmin())
            if times[k] > left:
                break
            place += times[k] * speed
            speed -= 2.0 * rates[k] * normals[k]
            left, bounces = left - times[k], bounces + 1
        place += left * speed
    return x, v, bounces


def gas(forces: list[Any], box: Any = None, n: int = 40) -> kd.System:
    rng = np.random.default_rng(2)
    x = rng.uniform(0.1, EDGE - 0.1, (n, 3))
    return kd.System(x, rng.normal(size=(n, 3)), rng.uniform(0.5, 2.0, n), box=box, forces=forces)


def mirrors() -> Iterator[Claim]:
    for name, dt in (("velocity-verlet", 0.01), ("velocity-verlet", 9.0), ("yoshida6", 3.0)):
        system = gas(room())
        sim = kd.Simulation(system, name, dt)
        sim.run(1000)
        apart = sim.state.positions - folded(system.state.positions + sim.time * system.state.velocities)
        text = f"free particles between six hard walls, {name}, dt = {dt:g}, 1000 steps: largest distance"
        yield at_most(text, float(np.abs(apart).max()), 1e-12 * sim.time, LINES)
    system, normals = wedge()
    x, v, bounces = bounced(system, normals, 5.0)
    sim = kd.Simulation(system, "velocity-verlet", 5.0)
    sim.run(1)
    apart = sim.state.phase - np.array([x.T, v.T])
    text = f"{bounces} bounces between walls at 50 degrees in one step: largest difference of place and velocity"
    yield at_most(text, float(np.abs(apart).max()), 1e-12, "bounces one by one")
    x = np.stack(np.meshgrid(*[[0.7, 2.0, 3.3]] * 3), -1).reshape(-1, 3)
    v = np.random.default_rng(7).normal(size=x.shape)
    system = kd.System(x, v, forces=[kd.LennardJones(cutoff=2.5, truncation="switch"), *room()])
    sim = kd.Simulation(system, "velocity-verlet", 0.002)
    sim.run(500)
    state = sim.state
    back = kd.Simulation(system.at(np.array([state.phase[0], -state.phase[1]]), 0.0), "velocity-verlet", 0.002)
    back.run(500)
    far = float(np.abs(back.state.positions - x).max())
    text = "27 Lennard-Jones particles between hard walls, 500 steps and back: largest distance from the start"
    yield at_most(text, far, 1e-9, "the start")


def oscillators() -> Iterator[Claim]:
    """Errors of dt and half of it differ by four."""
    particles = gas([kd.Restraint((2.0, 8.0, 3.0))], (5.0, 5.0, 5.0))
    stiffness, masses = np.array([2.0, 8.0, 3.0]), particles.state.masses[:, None]
    rate = np.sqrt(stiffness / masses)
    wall = kd.System([[0.0, 0.0, 0.0]], [[-0.7, 0.3, 0.0]], forces=[kd.HarmonicWall(4.0, (1.0, 0.0, 0.0))])
    cases = {
        "restrained particles": (
            particles, 50.0, lambda t: particles.state.positions + particles.state.velocities * np.sin(rate * t) / rate
        ),
        "a particle inside a harmonic wall": (
            wall, 1.5, lambda t: np.array([[-0.35 * np.sin(2.0 * t), 0.3 * t, 0.0]])
        ),
    }  # fmt: skip
    for name, (system, time, solution) in cases.items():
        errors = []
        for dt in (0.01, 0.005):
            sim = kd.Simulation(system, "velocity-verlet", dt)
            report = sim.run(round(time / dt))
            errors.append(float(np.abs(sim.state.positions - solution(sim.time)).max()))
            bounded = report.energy.max_relative_error if report.energy else np.nan
        yield at_most(f"{name}, dt = 0.005, to t = {time:g}: largest distance", errors[1], 2e-2, CLOSED)
        text = f"{name}: error at dt = 0.01 over that at 0.005"
        yield claim(text, errors[0] / errors[1], "3 to 5", 3.0 <= errors[0] / errors[1] <= 5.0, "order two")
        yield at_most(f"{name}: largest relative error of the energy", float(bounded), 1e-3, "the energy at the start")


def images() -> Iterator[Claim]:
    rng = np.random.default_rng(8)
    for name, force in (("trap", kd.HarmonicTrap(2.0, (1.0, 2.0, 3.0))), ("restraint", restraint())):
        x = rng.uniform(0.0, 5.0, (9, 3))
        found = []
        for moved in (x, x + rng.integers(-3, 4, (9, 3)) @ LEANING):
            sim = kd.Simulation(kd.System(moved, box=LEANING, forces=[force]), "velocity-verlet", 0.01)
            found.append(np.append(sim.forces().ravel(), sim.energy().potential))
        off = float(np.abs(found[1] - found[0]).max() / np.abs(found[0]).max())
        yield at_most(f"{name} in a leaning box: particles moved by whole edges, relative change", off, 1e-12, "itself")
    h, values = 1e-4, []
    for scale in (1 - h, 1 + h, 1.0):
        system = kd.System(scale * x, box=scale * LEANING, forces=[restraint()])
        values.append(kd.Simulation(system, "velocity-verlet", 0.01).sample())
    slope = (values[1].energies.potential - values[0].energies.potential) / (2 * h)
    off = abs(3.0 * values[2].pressure * np.linalg.det(LEANING) / -slope - 1.0)
    yield at_most("restraint that scales: its virial, relative", off, 1e-6, "the slope of its energy with the box")


def restraint() -> kd.Restraint:
    places = np.random.default_rng(5).uniform(0.0, 5.0, (9, 3))
    return kd.Restraint(3.0, range(9), places.tolist(), box=LEANING.tolist())


def claims(long: bool = False) -> Iterator[Claim]:
    yield from mirrors()
    yield from oscillators()
    yield from images()


if __name__ == "__main__":
    main(claims, __doc__)
