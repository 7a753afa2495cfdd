"""Potentials of galaxies beside galpy and gala: accelerations, slopes, a stream's orbit; and starts of clusters.

Places of accelerations lie between 0.03 and 30 units of length in all directions, at a time when bars have turned. The
orbit is that of the stream GD-1 (Bovy 2014, doi:10.1088/0004-637X/795/1/95) in MWPotential2014, over 3 Gyr.
"""

import math
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.starts import clusters, king
from kickdrift.model.starts.plummer import pair_sum
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import unit_system
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run

NEEDS = "pip install galpy gala"
TIME, PLACES = 0.9, 200
GALPYS: dict[str, tuple[str, dict[str, Any]]] = {
    "kepler": ("KeplerPotential", {"amp": 1.3}),
    "plummer": ("PlummerPotential", {"amp": 1.3, "b": 0.4}),
    "isochrone": ("IsochronePotential", {"amp": 1.3, "b": 0.4}),
    "hernquist": ("HernquistPotential", {"amp": 2.6, "a": 0.4}),
    "nfw": ("NFWPotential", {"amp": 1.3, "a": 0.4}),
    "miyamoto-nagai": ("MiyamotoNagaiPotential", {"amp": 1.3, "a": 0.4, "b": 0.05}),
    "power-law": ("PowerSphericalPotentialwCutoff", {"amp": 1.3, "alpha": 1.8, "rc": 0.5}),
    "logarithmic": ("LogarithmicHaloPotential", {"amp": 1.3, "core": 0.1, "q": 0.8, "b": 0.9}),
    "bar": ("SoftenedNeedleBarPotential", {"amp": 1.3, "a": 0.8, "b": 0.1, "c": 0.2, "pa": 0.3, "omegab": 0.7}),
}
GD1_X, GD1_V = (12.4, 1.5, 7.1), ("107 km/s", "-243 km/s", "-105 km/s")
GYR = 3000.0  # Myr


def places() -> np.ndarray:
    """Places in all directions, at distances of three decades."""
    rng = np.random.default_rng(1)
    found: np.ndarray = rng.normal(size=(PLACES, 3)) * np.logspace(-1.5, 1.5, PLACES)[:, None]
    return found


def accelerations(force: Any, x: np.ndarray, units: str = "nbody", time: float = TIME) -> np.ndarray:
    """kickdrift's accelerations of massless bodies at x."""
    system = kd.System(x, np.zeros_like(x), 0.0, forces=[force], units=units)
    found: np.ndarray = BoundForces(system).measure(time, system.state.phase).accelerations.T
    return found


def of_galpy(potential: Any, x: np.ndarray, time: float = TIME) -> np.ndarray:
    """galpy's accelerations at x, in natural units."""
    from galpy import potential as galpys

    radius, angle = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])

    def each(function: Any) -> np.ndarray:
        return np.array([function(potential, r, z, phi=p, t=time, use_physical=False)
                         for r, z, p in zip(radius, x[:, 2], angle, strict=True)])  # fmt: skip

    out, along = each(galpys.evaluateRforces), each(galpys.evaluatephitorques) / radius
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([out * cosine - along * sine, out * sine + along * cosine, each(galpys.evaluatezforces)], axis=1)


def apart(found: np.ndarray, wanted: np.ndarray) -> float:
    """Largest difference over the length of the wanted vector."""
    return float((np.linalg.norm(found - wanted, axis=1) / np.linalg.norm(wanted, axis=1)).max())


def beside_galpy() -> Iterator[Claim]:
    """Accelerations of every potential, of the Milky Way, and with a strength that changes."""
    from galpy import potential as galpys

    x = places()
    for kind, (name, given) in GALPYS.items():
        there = getattr(galpys, name)(**given)
        force = kd.Galaxy.from_galpy(there, "nbody")
        text = f"{kind}: accelerations at {PLACES} places, relative difference"
        yield at_most(text, apart(accelerations(force, x), of_galpy(there, x)), 1e-12, f"galpy, {name}")
    milky_way = galpys.MWPotential2014
    text = f"MWPotential2014: accelerations at {PLACES} places, relative difference"
    yield at_most(text, apart(accelerations(kd.Galaxy("MWPotential2014"), x), of_galpy(milky_way, x)), 1e-12, "galpy")
    halo = galpys.NFWPotential(amp=1.3, a=0.4)
    growing = galpys.TimeDependentAmplitudeWrapperPotential(
        amp=1.0, pot=halo, A=lambda t: 1.0 + 0.3 * math.sin(2.0 * t) * math.exp(-0.1 * t)
    )
    force = kd.Galaxy({"kind": "nfw", "mass": 1.3, "a": 0.4, "strength": "1+0.3*sin(2*t)*exp(-0.1*t)"})
    worst = largest(*(apart(accelerations(force, x, time=t), of_galpy(growing, x, t)) for t in (0.0, 0.7, 5.3)))
    text = "nfw with a strength that changes: accelerations at three times, relative difference"
    yield at_most(text, worst, 1e-12, "galpy, TimeDependentAmplitudeWrapperPotential")


def near_the_centre() -> Iterator[Claim]:
    """Potentials with differences that cancel, from 1e-6 scale lengths on."""
    import mpmath

    mpmath.mp.dps = 40
    distances = np.logspace(-6, 1.5, 40)
    x = np.stack([distances, 0.0 * distances, 0.0 * distances], axis=1)

    def nfw(r: Any) -> Any:
        return -(mpmath.log(1 + r) - r / (1 + r)) / r**2

    found = accelerations(kd.Galaxy({"kind": "nfw", "mass": 1.0, "a": 1.0}), x)[:, 0]
    worst = max(float(abs(a / nfw(mpmath.mpf(r)) - 1)) for a, r in zip(found, distances, strict=True))
    yield at_most("nfw: accelerations from 1e-6 to 30 scale lengths, relative error", worst, 1e-14, "mpmath, 40 digits")
    for alpha in (0.0, 1.0, 1.8, 2.0, 2.7):
        force = kd.Galaxy({"kind": "power-law", "mass": 1.0, "alpha": alpha, "cutoff": 1.0})
        found = accelerations(force, x)[:, 0]
        s = (3 - mpmath.mpf(alpha)) / 2
        worst = max(
            float(abs(-a * mpmath.mpf(r) ** 2 / mpmath.gammainc(s, 0, mpmath.mpf(r) ** 2, regularized=True) - 1))
            for a, r in zip(found, distances, strict=True)
        )
        text = f"power-law, alpha = {alpha}: accelerations from 1e-6 to 30 cutoffs, relative error"
        yield at_most(text, worst, 1e-13, "mpmath, 40 digits")


def beside_gala() -> Iterator[Claim]:
    """Bridges to gala and back."""
    import astropy.units as u
    from gala import potential as galas
    from gala.units import galactic

    x = places() * 8.0
    for there in (
        galas.MilkyWayPotential(version="v1"), galas.BovyMWPotential2014(),
        galas.LogarithmicPotential(220 * u.km / u.s, 0.2 * u.kpc, 1.2, 0.9, 0.8, 0.3 * u.rad, units=galactic),
        galas.LongMuraliBarPotential(1e10 * u.Msun, 3 * u.kpc, 0.1 * u.kpc, 0.5 * u.kpc, 0.3 * u.rad, units=galactic),
    ):  # fmt: skip
        force = kd.Galaxy.from_gala(there)
        wanted = -there.gradient(x.T * u.kpc).decompose(galactic).value.T
        text = f"from_gala, {type(there).__name__}: accelerations, relative difference"
        yield at_most(text, apart(accelerations(force, x, "galactic"), wanted), 1e-12, "gala")
        system = kd.System(x, 0.0 * x, 0.0, forces=[force], units="galactic")
        positions, back = system.to_gala()
        again = -back.gradient(positions).decompose(galactic).value.T
        yield at_most(f"to_gala, {type(there).__name__}: relative difference", apart(again, wanted), 1e-12, "gala")


def gd1(method: str, dt: float | None = None, **given: Any) -> tuple[np.ndarray, kd.System]:
    """Positions along the orbit of GD-1, every 30 Myr, and its System."""
    units = unit_system("galactic")
    v = [[quantity(each, "velocity", units) for each in GD1_V]]
    start = kd.System([GD1_X], v, 0.0, forces=[kd.Galaxy("MWPotential2014")], units=units)
    sim, found = kd.Simulation(start, method, dt, **given), [np.array(GD1_X)]
    for k in range(1, round(GYR / 30.0) + 1):
        sim.run(until=30.0 * k)
        found.append(sim.state.positions[0].copy())
    return np.array(found), start


def orbits() -> Iterator[Claim]:
    """The orbit of GD-1 beside galpy's DOP853 and gala's leapfrog."""
    from gala import integrate as galas
    from gala.units import galactic

    found, start = gd1("dop853", rtol=1e-12, atol=1e-13)
    orbit, there = start.to_galpy()
    rate = quantity("220 km/s", "velocity", start.units) / 8.0
    times = np.arange(len(found)) * 30.0 * rate  # in galpy's unit of time
    orbit.integrate(times, there, method="dop853_c")
    wanted = np.squeeze(np.stack([getattr(orbit, key)(times, use_physical=False) * 8.0 for key in "xyz"], axis=-1))
    text = "GD-1 over 3 Gyr by dop853, rtol 1e-12: largest distance from the orbit, kpc"
    yield at_most(text, float(np.linalg.norm(found - wanted, axis=1).max()), 1e-7, "galpy, dop853_c")
    found, start = gd1("velocity-verlet", 0.5)
    begin, milky_way = start.to_gala()
    path = milky_way.integrate_orbit(
        begin, dt=0.5, n_steps=round(GYR / 0.5), Integrator=galas.LeapfrogIntegrator, cython_if_possible=True
    )
    wanted = np.squeeze(path.pos.xyz.decompose(galactic).value).T[::60]
    text = "GD-1 over 3 Gyr by velocity-verlet, dt = 0.5 Myr: largest distance from the same steps, kpc"
    yield at_most(text, float(np.linalg.norm(found - wanted, axis=1).max()), 1e-8, "gala, LeapfrogIntegrator")


def jacobi() -> Iterator[Claim]:
    """The energy in the frame of a bar that turns is conserved."""
    omega = 0.7
    parts = [{"kind": "bar", "mass": 1.0, "a": 0.8, "b": 0.1, "c": 0.2, "omega": omega},
             {"kind": "logarithmic", "speed": 1.0, "core": 0.1, "q": 0.8, "p": 0.9, "omega": omega}]  # fmt: skip
    system = kd.System([[1.0, 0.3, 0.2]], [[0.1, 0.8, 0.3]], 1.0, forces=[kd.Galaxy(parts)], units="nbody")
    sim, values = kd.Simulation(system, "gauss-radau15", 0.1), []
    for time in range(0, 101, 4):
        if time:
            sim.run(until=float(time))
        sample = sim.sample()
        values.append(sample.energies.total - omega * float(sample.angular_momentum[2]))
    yield at_most("a bar and a halo turn: drift of the Jacobi energy over 100 times, relative",
                  float(np.ptp(values) / abs(values[0])), 1e-12, "Binney & Tremaine 2008, eq. 3.112")  # fmt: skip


def apart_from_lsoda(depth: float) -> float:
    """Largest relative difference of tidal radius and mass from the solution of King's equation in log(r)."""
    from scipy.integrate import solve_ivp
    from scipy.special import erf

    def density(w: float) -> float:
        w = max(w, 0.0)
        value = math.exp(w) * erf(math.sqrt(w)) - math.sqrt(4.0 * w / math.pi) * (1.0 + 2.0 * w / 3.0)
        return float(value) if w > 0.1 else 8.0 / (15.0 * math.sqrt(math.pi)) * w**2.5 * (
            1.0 + w * (2.0 / 7.0 + w * (4.0 / 63.0 + w * (8.0 / 693.0 + w * 16.0 / 9009.0)))
        )  # fmt: skip

    def slope(x: float, y: np.ndarray) -> list[float]:
        return [-y[1] / math.exp(x), 9.0 * math.exp(3.0 * x) * density(depth * y[0]) / density(depth)]

    def end(x: float, y: np.ndarray) -> float:
        return float(y[0])

    end.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(
        slope, (math.log(1e-5), 20.0), [1.0 - 1.5e-10, 3e-15], "LSODA", rtol=1e-12, atol=1e-14, events=end
    )
    here = king.profile(depth)
    return largest(
        abs(math.exp(found.t_events[0][0]) / here.radii[-1] - 1.0), abs(found.y[1, -1] / here.masses[-1] - 1.0)
    )


def king_models() -> Iterator[Claim]:
    """King's models beside another solver of their equation and beside galpy's, and in equilibrium."""
    for depth in (1.0, 3.0, 6.0, 9.0, 12.0, 16.0):
        text = f"king, W0 = {depth:g}: tidal radius and mass, relative difference"
        yield at_most(text, apart_from_lsoda(depth), 1e-7, "SciPy's LSODA in the logarithm of the radius")
    if find_spec("galpy"):
        from galpy import potential as galpys
        from galpy.df import kingdf

        for depth in (1.0, 3.0, 6.0):
            there, here = kingdf(depth, M=1.0, rt=1.0), king.profile(depth)
            text = f"king, W0 = {depth:g}: logarithm of tidal over core radius, difference"
            yield at_most(text, abs(here.concentration - float(there.c)), 1e-4, "galpy, kingdf")
            radii = np.linspace(0.05, 1.0, 20)
            wanted = [float(galpys.mass(there._pot, r, use_physical=False)) for r in radii]
            within = np.interp(radii * here.radii[-1], here.radii, here.masses) / here.masses[-1]
            text = f"king, W0 = {depth:g}: mass within twenty radii over the whole, difference"
            yield at_most(text, float(np.abs(within - wanted).max()), 1e-3, "galpy, kingdf")
    for depth in (0.0, 3.0, 6.0, 12.0, 16.0):
        x, v, _ = king.draw(depth, 40_000, np.random.default_rng(2))
        ratio = 0.5 * float(np.mean(np.sum(v**2, axis=1))) / (pair_sum(x) / len(x) ** 2)
        text = f"king, W0 = {depth:g}: kinetic over minus potential energy of 40,000 stars, less 1/2"
        yield at_most(text, abs(ratio - 0.5), 0.01, "virial theorem")


def starts() -> Iterator[Claim]:
    """Masses, segregation and binaries of drawn clusters beside their distributions."""
    from scipy.stats import kstest

    for name, (slopes, between) in clusters.MASS_FUNCTIONS.items():
        masses = clusters.masses_drawn(name, 200_000, 3, 0.1, 50.0)
        edges = [0.1, *(each for each in between if each > 0.1), 50.0]
        used = slopes[len(slopes) - len(edges) + 1 :]
        grid = np.geomspace(0.1, 50.0, 400_001)
        density, k = np.ones_like(grid), np.searchsorted(edges[1:-1], grid, side="right")
        for i, slope in enumerate(used):
            join = 1.0 if i == 0 else density[np.flatnonzero(k == i - 1)[-1]] * edges[i] ** slope
            density[k == i] = join * grid[k == i] ** -slope
        whole = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(grid))])
        found = kstest(masses, lambda m, grid=grid, whole=whole: np.interp(m, grid, whole / whole[-1])).pvalue
        text = f"{name}: 200,000 masses, probability by Kolmogorov and Smirnov"
        yield claim(text, float(found), "at least 0.01", found >= 0.01, "numerical integral of the mass function")
    made = kd.cluster("plummer", 4000, 5, masses="kroupa", mass_range=[0.1, 20.0], segregation=1.0)
    mixed = kd.cluster("plummer", 4000, 5, masses="kroupa", mass_range=[0.1, 20.0])
    sizes = []
    for each in (made, mixed):
        r, m = np.linalg.norm(each.state.positions, axis=1), each.state.masses
        sizes.append(float(np.median(r[m > np.quantile(m, 0.95)]) / np.median(r)))
    yield claim("segregated Plummer: median distance of the heaviest 5 % over that of all", sizes[0], "under 0.4",
                sizes[0] < 0.4, "without segregation it is 1 within its error")  # fmt: skip
    yield at_most("without segregation: the same ratio, less 1", abs(sizes[1] - 1.0), 0.15, "200 stars: 0.05")
    sample = kd.Simulation(made).sample()
    yield at_most(
        "segregated Plummer: total energy, less -1/4", abs(sample.energies.total + 0.25), 1e-12, "Henon's units"
    )
    pairs = {"fraction": 0.4, "a": [1e-4, 1e-2]}
    system = kd.cluster("king", 14_000, 7, W0=5.0, masses="salpeter", binaries=pairs)
    count = round(0.4 * 14_000 / 1.4)
    x, v, m = (
        system.state.positions[: 2 * count],
        system.state.velocities[: 2 * count],
        system.state.masses[: 2 * count],
    )
    total = m[::2] + m[1::2]
    d, u = x[1::2] - x[::2], v[1::2] - v[::2]
    r = np.linalg.norm(d, axis=1)
    a = 1.0 / (2.0 / r - np.sum(u**2, axis=1) / total)
    e2 = 1.0 - np.sum(np.cross(d, u) ** 2, axis=1) / (total * a)
    for text, value in (
        ("semi-major axes uniform in log(a)", kstest(np.log(a), "uniform", (math.log(1e-4), math.log(100.0))).pvalue),
        ("squares of eccentricities uniform", kstest(e2, "uniform").pvalue),
    ):
        yield claim(f"{count} binaries: {text}, probability by Kolmogorov and Smirnov", float(value), "at least 0.01",
                    value >= 0.01, "distribution asked")  # fmt: skip


def claims(long: bool = False) -> Iterator[Claim]:
    """Potentials, orbits and starts."""
    if find_spec("galpy"):
        yield from beside_galpy()
    else:
        yield not_run("accelerations", "at most 1e-12", "galpy", NEEDS)
    if find_spec("mpmath"):
        yield from near_the_centre()
    if find_spec("gala"):
        yield from beside_gala()
    else:
        yield not_run("accelerations beside gala", "at most 1e-12", "gala", NEEDS)
    if find_spec("gala") and find_spec("galpy"):
        yield from orbits()
    yield from jacobi()
    yield from king_models()
    yield from starts()


if __name__ == "__main__":
    main(claims, __doc__)
