"""What a cluster tells, beside Plummer's sphere and pynbody; block steps over the tree, beside rebound and pytreegrav.

Spheres of 1000 stars have the radii, the core and the isotropy of Plummer's model in closed form, in units of its scale
length a: half-mass radius (2^(2/3) - 1)^(-1/2), core radius by Casertano & Hut 1985 as the integral of r rho^2 over
that of rho^2, and the mean density with the weight rho^2. A snapshot is read as pynbody reads it. Then 10,000
stars move for two units of N-body time, seven tenths of a crossing time: by leapfrog-block, and with a
dense nucleus also by leapfrog with shared steps; in the long set also by rebound's leapfrog and one over
pytreegrav's accelerations, in turns, in processor time of one thread.
"""

import math
import tempfile
from collections.abc import Iterator
from ctypes import byref
from pathlib import Path
from time import process_time

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.plummer import plummer
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run

SCALE = 3 * math.pi / 16
SPHERES, STARS = 16, 1000
CORE, DENSITY = 0.6791, 0.4631  # of a, and of the central density: ratios of beta functions
MANY, SOFTENING, LENGTH, ACCURACY = 10_000, 0.01, 2.0, 1e-2
DT, ETA, SHARED = 1 / 16, 0.01, 1 / 64
ANGLES = {"rebound": 0.35, "pytreegrav": 0.5}  # their opening angles
NUCLEUS, BESIDE = 0.25, 0.5  # lengths of the runs with a nucleus, and beside other programs
SAMPLE = 300


def spheres() -> Iterator[Claim]:
    found = []
    for seed in range(SPHERES):
        x, v, masses = plummer(STARS, seed, scaled=False)
        found.append(kd.analysis.cluster(kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody")))
    half = 1 / math.sqrt(2 ** (2 / 3) - 1)
    for text, key, unit, exact in (
        ("half-mass radius over a", "half_mass_radius", SCALE, half),
        ("core radius over a", "core_radius", SCALE, CORE),
        ("core density over the central density", "core_density", 3 / (4 * math.pi * SCALE**3), DENSITY),
        ("anisotropy", "anisotropy", 1.0, 0.0),
    ):
        values = np.array([getattr(each, key) for each in found]) / unit
        error = float(values.std(ddof=1) / math.sqrt(SPHERES))
        off = abs(float(values.mean()) - exact) / error
        print(f"{text}: {values.mean():.4f} +- {error:.4f}, exact {exact:.4f}")
        name = f"{SPHERES} spheres of {STARS} stars: {text}, {values.mean():.4f}; off by so many standard errors"
        yield at_most(name, off, 3.5, f"Plummer's sphere: {exact:.4f}")


def snapshot() -> Iterator[Claim]:
    text, bound = (
        "a snapshot in GADGET's layout, as pynbody reads it: largest difference of positions, velocities, masses",
        "0",
    )
    try:
        import pynbody
    except ImportError:
        yield not_run(text, bound, "pynbody", "pip install pynbody")
        return
    import h5py

    x, v, masses = plummer(STARS, 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stars.hdf5"
        with h5py.File(path, "w") as file:
            count = np.array([0, 0, 0, 0, STARS, 0])
            zeros = dict.fromkeys(("Redshift", "Omega0", "OmegaLambda", "HubbleParam", "BoxSize"), 0.0)
            numbers = dict.fromkeys(("NumPart_ThisFile", "NumPart_Total"), count)
            counts = {"NumPart_Total_HighWord": 0 * count, "MassTable": np.zeros(6), "NumFilesPerSnapshot": 1}
            file.create_group("Header").attrs.update({"Time": 0.5, **zeros, **numbers, **counts})
            for key, values in (("Coordinates", x), ("Velocities", v), ("Masses", masses)):
                file[f"PartType4/{key}"] = values
            file["PartType4/ParticleIDs"] = np.arange(STARS)
        here = kd.System.from_snapshot(path, units="nbody").state
        there = pynbody.load(str(path))
        x, v, masses = (np.asarray(there.star[key]) for key in ("pos", "vel", "mass"))
    pairs = ((here.positions, x), (here.velocities, v), (here.masses, masses))
    off = max(float(np.abs(a - b).max()) for a, b in pairs)
    yield claim(text, off, bound, off == 0.0, f"pynbody {pynbody.__version__}")


def energy(x: np.ndarray, v: np.ndarray, masses: np.ndarray) -> float:
    return float(kd.System(x, v, masses, forces=[kd.Gravity(softening=SOFTENING)], units="nbody").energy().total)


def ours(
    x: np.ndarray, v: np.ndarray, masses: np.ndarray, name: str, time: float = 0.0, **options: float
) -> tuple[float, float, int]:
    """Energy error, processor time and force evaluations of a run by kickdrift's tree."""
    system = kd.System(x, v, masses, forces=[kd.GravityTree(ACCURACY, softening=SOFTENING)], units="nbody")
    kd.Simulation(system, name, **options).run(1)  # compiled
    sim = kd.Simulation(system, name, **options)
    began = process_time()
    report = sim.run(until=time or LENGTH)
    took = process_time() - began
    error = abs(energy(sim.state.positions, sim.state.velocities, masses) / energy(x, v, masses) - 1)
    print(f"{name} {options}: energy {error:.1e}, {report.force_evaluations} evaluations, {took:.2f} s", flush=True)
    return error, took, report.force_evaluations


def block_steps(x: np.ndarray, v: np.ndarray, masses: np.ndarray) -> Iterator[Claim]:
    """A Plummer sphere, whose steps differ by a factor of eight; then the same with a dense nucleus."""
    coarse, fine = (ours(x, v, masses, "leapfrog-block", dt=DT, eta=eta) for eta in (4 * ETA, ETA))
    run = f"{MANY} stars, {LENGTH:g} units of time"
    yield at_most(f"{run}, leapfrog-block, eta {ETA}: relative energy error", fine[0], 5e-4, "the direct sum")
    text = f"{run}: error at 4 eta over that at eta"
    yield claim(text, coarse[0] / fine[0], "above 1.5", coarse[0] > 1.5 * fine[0], "4 for order 2, without the tree's")
    small = len(masses) // 20
    inner = plummer(small, 2, scaled=False)
    weight, size = 0.05, 0.02  # mass and length of the nucleus; its stars move by its own gravity
    place = np.concatenate([x, size * inner[0]])
    speed = np.concatenate([v, math.sqrt(weight / size) * inner[1]])
    heavy = np.concatenate([masses, weight * inner[2]])
    block = ours(place, speed, heavy, "leapfrog-block", time=NUCLEUS, dt=DT, eta=ETA / 4)
    shared = ours(place, speed, heavy, "leapfrog", time=NUCLEUS, dt=DT / 128)
    text = f"with a nucleus, {NUCLEUS:g} units of time: evaluations of leapfrog with dt = 1/2048 over leapfrog-block's"
    text += f"; energy errors {shared[0]:.1e} and {block[0]:.1e}"
    yield claim(text, shared[2] / block[2], "above 3", shared[2] > 3 * block[2], "shared steps, the same tree")


def by_potential_of_the_tree(x: np.ndarray, masses: np.ndarray) -> Claim:
    """The potential by which stars count as bound: the tree above 3000 stars, beside the sum over all pairs."""
    from kickdrift.analysis.clusters import stars

    system = kd.System(x, masses=masses, forces=[kd.Gravity(softening=SOFTENING)], units="nbody")
    there = stars.stars_of(system, "cluster")
    tree, before = stars.potentials(there), stars.DIRECT
    stars.DIRECT = len(masses)
    try:
        exact = stars.potentials(there)
    finally:
        stars.DIRECT = before
    off = float(np.abs(tree / exact - 1).max())
    return at_most(f"{len(masses)} stars: largest relative error of the potential by the tree", off, 1e-4, "all pairs")


def beside_others(x: np.ndarray, v: np.ndarray, masses: np.ndarray) -> Iterator[Claim]:
    """Runs in turns: leapfrog-block, then leapfrog with shared steps and the tree of another program."""
    chosen = np.sort(np.random.default_rng(1).choice(MANY, SAMPLE, replace=False))
    system = kd.System(x, masses=masses, forces=[kd.GravityTree(ACCURACY, softening=SOFTENING)], units="nbody")
    here = rms(kd.Simulation(system, "leapfrog", dt=DT).accelerations()[chosen], direct(x, masses, chosen))
    steps = round(BESIDE / SHARED)
    for name, moved in (("rebound", by_rebound), ("pytreegrav", by_pytreegrav)):
        text = f"{MANY} stars, {BESIDE:g} units of time: time of {name}'s tree over that of leapfrog-block"
        error, took, _ = ours(x, v, masses, "leapfrog-block", time=BESIDE, dt=DT, eta=ETA)
        try:
            theirs, place, speed, other = moved(x, v, masses, chosen, steps)
        except ImportError:
            yield not_run(text, "above 3", name, f"pip install {name}")
            continue
        drift = abs(energy(place, speed, masses) / energy(x, v, masses) - 1)
        print(
            f"{name}: energy {drift:.1e}, {steps} steps, {other:.2f} s; rms errors of forces {theirs:.1e}, {here:.1e}"
        )
        text += f"; energy errors {drift:.1e} and {error:.1e}, rms errors of forces {theirs:.1e} and {here:.1e}"
        met = other > 3 * took and here <= theirs
        yield claim(text, other / took, "above 3", met, f"{name}, opening angle {ANGLES[name]}, dt = 1/64")


def rms(a: np.ndarray, exact: np.ndarray) -> float:
    return float(np.sqrt(np.mean(((a - exact) ** 2).sum(axis=1) / (exact**2).sum(axis=1))))


def direct(x: np.ndarray, masses: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(k, 3) accelerations of the chosen stars, G = 1."""
    found = []
    for i in chosen:
        d = x - x[i]
        found.append((masses / ((d * d).sum(axis=1) + SOFTENING**2) ** 1.5) @ d)
    return np.array(found)


Moved = tuple[float, np.ndarray, np.ndarray, float]  # rms error of forces, positions, velocities, seconds


def by_rebound(x: np.ndarray, v: np.ndarray, masses: np.ndarray, chosen: np.ndarray, steps: int) -> Moved:
    """rebound's own leapfrog over its tree."""
    import rebound

    sim = rebound.Simulation()
    sim.root_size, sim.gravity, sim.softening = 6.0 * float(np.abs(x).max()), "tree", SOFTENING
    sim.opening_angle2, sim.integrator, sim.dt = ANGLES["rebound"] ** 2, "leapfrog", SHARED
    body = rebound.Particle()
    for m, at, speed in zip(masses, x, v, strict=True):
        body.m, (body.x, body.y, body.z), (body.vx, body.vy, body.vz) = m, at, speed
        sim.add(body)
    rebound.clibrebound.reb_simulation_update_acceleration(byref(sim))
    a = np.array([[sim.particles[int(i)].ax, sim.particles[int(i)].ay, sim.particles[int(i)].az] for i in chosen])
    began = process_time()
    sim.steps(steps)
    took = process_time() - began
    rows = np.array([[p.x, p.y, p.z, p.vx, p.vy, p.vz] for p in sim.particles])
    return rms(a, direct(x, masses, chosen)), rows[:, :3], rows[:, 3:], took


def by_pytreegrav(x: np.ndarray, v: np.ndarray, masses: np.ndarray, chosen: np.ndarray, steps: int) -> Moved:
    """Kicks and drifts in NumPy with the accelerations of pytreegrav's tree; its errors are those from its own sum."""
    import pytreegrav

    soft = np.full(len(masses), 2.8 * SOFTENING)  # radius of a spline whose potential at the centre is the same

    def accelerations(place: np.ndarray, method: str = "tree") -> np.ndarray:
        angle = ANGLES["pytreegrav"]
        return np.asarray(pytreegrav.Accel(place, masses, soft, theta=angle, method=method, parallel=False))

    place, speed = x.copy(), v.copy()
    a, exact = accelerations(place), accelerations(place, "bruteforce")  # compiled
    began = process_time()
    for _ in range(steps):
        speed += 0.5 * SHARED * a
        place += SHARED * speed
        a = accelerations(place)
        speed += 0.5 * SHARED * a
    return rms(accelerations(x)[chosen], exact[chosen]), place, speed, process_time() - began


def claims(long: bool = False) -> Iterator[Claim]:
    """The other programs in the long set only."""
    yield from spheres()
    yield from snapshot()
    x, v, masses = plummer(MANY, 1, scaled=False)
    yield by_potential_of_the_tree(x, masses)
    yield from block_steps(x, v, masses)
    if long:
        yield from beside_others(x, v, masses)


if __name__ == "__main__":
    main(claims, __doc__)
