# %% [markdown]
# # The melting lines of copper and silicon
#
# A crystal and its melt, side by side in one box, find the melting point by themselves. At constant pressure and
# enthalpy, crystal that grows heats the box and crystal that melts cools it, until both stay. Copper melts later under
# pressure, because its melt is wider than the crystal. Silicon's melt is denser, so silicon melts earlier.

# %%
import time

import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd
from kickdrift.statistics.blocks import block_average

GPA = 1.0 / 160.2176634  # in eV per cubic angstrom
DT = {"copper-864": 0.003, "silicon-512": 0.002}  # ps
RUNS = 2  # with other random numbers, at each pressure
FCC = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
began = time.process_time()

# %% [markdown]
# ## A crystal beside its melt
#
# The box is long along z. Springs hold the lower half of the crystal while the upper half melts far above its melting
# point. Then the whole cools to a guess of the melting point, and the springs go. Edges along x and y stay alike, so
# that a slab of crystal keeps its square.


# %%
def crystal(name, cells, edge):
    """The crystal of a shipped system, with so many unit cells of this edge along x, y and z."""
    base = kd.load(name)
    unit = FCC if name.startswith("copper") else np.concatenate([FCC, FCC + 0.25])
    corners = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), -1).reshape(-1, 1, 3)
    x = ((corners + unit + 0.125) * edge).reshape(-1, 3)
    return kd.System(
        x, masses=base.state.masses[0], box=np.array(cells) * edge, forces=base.forces, units="metal",
        species=[base.species[0]] * len(x),
    )  # fmt: skip


def pressed(pressure, coupling="semi-isotropic"):
    """Options of a gentle barostat."""
    return {
        "pressure": pressure * GPA, "pressure_tau": 0.5, "compressibility": 0.01 / GPA, "coupling": coupling,
    }  # fmt: skip


def settled(system, dt, temperature, steps, **options):
    """The system after some steps of Langevin's bath."""
    sim = kd.Simulation(system, "baoab", dt, temperature=temperature, friction=2.0, **options)
    sim.advance(steps)
    return sim.now()


def two_phases(cold, dt, temperature, hot, pressure, seed):
    """Half crystal, half melt, near this temperature."""
    solid = settled(cold, dt, temperature, 1500, seed=seed, **pressed(pressure, "isotropic"))
    lower = np.flatnonzero(cold.state.positions[:, 2] < cold.box.lengths[2] / 2)
    held = solid.with_forces(*solid.forces, kd.Restraint(5.0, particles=lower))
    molten = settled(held, dt, hot, 2500, seed=seed + 1)
    cooled = settled(molten, dt, temperature, 1500, seed=seed + 2, **pressed(pressure))
    free = cooled.with_forces(*solid.forces)
    return settled(free, dt, temperature, 500, seed=seed + 3, **pressed(pressure))


# %% [markdown]
# ## Constant pressure and enthalpy
#
# The barostat `mtk` needs the heat bath `nose-hoover`. A bath with a time constant of 100 ns does nothing in a run of
# 100 ps. The edges of the box keep thermostats of their own, but these act on two numbers beside thousands. So the
# enthalpy is nearly constant. The temperature of the last two thirds is the melting point.


# %%
def coexistence(start, dt, temperature, pressure, picoseconds):
    """Times, temperatures and energies of atoms at constant pressure and enthalpy."""
    sim = kd.Simulation(
        start, "nose-hoover", dt, temperature=temperature, tau=1e5, pressure=pressure * GPA, pressure_tau=1.0,
        barostat="mtk", coupling="semi-isotropic",
    )  # fmt: skip
    sim.run(round(picoseconds / dt), every=25)
    samples = sim.record.samples
    return np.array([[each.time, each.temperature, each.energies.potential / len(start)] for each in samples]).T


def bulk(system, dt, temperature, pressure):
    """Mean energy and volume of an atom at a temperature and pressure, with their errors."""
    sim = kd.Simulation(system, "csvr", dt, temperature=temperature, tau=0.2, **pressed(pressure, "isotropic"))
    sim.advance(1000)
    sim.run(10_000, every=20)
    samples = sim.record.samples
    return block_average(np.array([[each.energies.potential, each.volume] for each in samples]) / len(system))


# %% [markdown]
# ## Two pressures
#
# Latent heat ΔH and change of volume ΔV of the two bulk phases give the slope of the melting line by Clausius and
# Clapeyron, dT/dP = T ΔV / ΔH. The slope at one pressure gives the guess for the next. At the end, the slope is an
# independent check of the points.
#
# The interfaces wander slowly, and the temperature with them. So each point has two runs with other random numbers, and
# its error comes from the differences of all pairs. The part of the crystal follows from the energy of the atoms, which
# lies between those of the two phases. A run counts only if both phases are there until its end.


# %%
def melting_line(name, cells, edge, guess, hot, pressures, picoseconds):
    """A row for each pressure: pressure, melting point, its error, slope, its error; and the traces."""
    dt, cold, small = DT[name], crystal(name, cells, edge), crystal(name, (4, 4, 4), edge)
    rows, points, traces = [], [], {}
    for k, pressure in enumerate(pressures):
        runs = []
        for seed in range(RUNS):
            start = two_phases(cold, dt, 1.03 * guess, hot, pressure, 10 * seed)
            runs.append(coexistence(start, dt, guess, pressure, picoseconds))
        points.append([temperatures[len(temperatures) // 3 :].mean() for _, temperatures, _ in runs])
        melting = np.mean(points[-1])
        liquid = settled(small, dt, hot, 2500)
        bulks = [settled(each, dt, melting, 1500, **pressed(pressure, "isotropic")) for each in (small, liquid)]
        solid, liquid = (bulk(each, dt, melting, pressure) for each in bulks)
        energy, volume = liquid.value - solid.value
        error = np.hypot(solid.error, liquid.error)
        heat = energy + pressure * GPA * volume
        slope = melting * volume / heat * GPA
        rows.append([pressure, melting, np.nan, slope, abs(slope) * np.hypot(error[1] / volume, error[0] / heat)])
        parts = [(liquid.value[0] - energies[-len(energies) // 10 :].mean()) / energy for *_, energies in runs]
        traces[pressure] = runs[0][:2]
        print(
            f"{name} {pressure:4.1f} GPa: T = {points[-1][0]:.0f} and {points[-1][1]:.0f} K, heat {heat:.4f} eV, "
            f"volume {volume:+.3f} A^3, crystal at the end {parts[0]:.2f} and {parts[1]:.2f}"
        )
        if k + 1 < len(pressures):
            guess = melting + slope * (pressures[k + 1] - pressure)
    rows = np.array(rows)
    rows[:, 2] = np.sqrt(np.var(points, axis=1, ddof=1).mean() / RUNS)
    for pressure, melting, error, slope, spread in rows:
        slopes = f"{slope:+.1f} +- {spread:.1f} K/GPa" if np.isfinite(spread) else f"{slope:+.1f} K/GPa, error unknown"
        print(f"{pressure:4.1f} GPa: {melting:6.1f} +- {error:.1f} K, dT/dP = {slopes}")
    return rows, traces


copper = melting_line("copper-864", (5, 5, 14), 3.70, 1170.0, 4000.0, (0.0, 10.0), 30.0)

# %%
silicon = melting_line("silicon-512", (3, 3, 12), 5.47, 1670.0, 4000.0, (0.0, 4.0), 120.0)
print(f"{time.process_time() - began:.0f} s of processor time")

# %% [markdown]
# ## The lines
#
# Lines show the slopes by Clausius and Clapeyron. The points lie on them, though points and slopes come from different
# runs. Simulations of Stillinger and Weber's silicon give (1691 ± 20) K at zero pressure
# ([Broughton & Li 1987](https://doi.org/10.1103/PhysRevB.35.9120)). The copper of Zhou, Johnson and Wadley is known to
# melt some 200 K below real copper, which melts at 1358 K. Errors are those of the wandering interfaces in short runs.
# What the small box itself does to the points is not in them.
# The page on crystals has the points of longer runs at three pressures.

# %%
figure, axes = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
for (left, right), (rows, traces), name in zip(axes, (copper, silicon), ("copper", "silicon"), strict=True):
    for pressure, (times, temperatures) in traces.items():
        smooth = np.convolve(temperatures, np.full(40, 1 / 40), "valid")
        left.plot(times[: len(smooth)], smooth, linewidth=0.9, label=f"{pressure:.0f} GPa")
    left.set(title=f"{name}: temperature of two phases", xlabel="time (ps)", ylabel="T (K)")
    left.legend()
    at, melting, error, slope, _ = rows.T
    right.errorbar(at, melting, error, fmt="o", capsize=3)
    for p, t, each in zip(at, melting, slope, strict=True):
        part = np.array([-1.0, 1.0]) * 0.35 * np.ptp(at) / (len(at) - 1)
        right.plot(p + part, t + each * part, color="C1")
    right.set(title=f"{name}: melting line", xlabel="P (GPa)", ylabel="T (K)")
plt.show()
