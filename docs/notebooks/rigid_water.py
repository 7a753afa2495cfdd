# %% [markdown]
# # Rigid water
#
# Rigid water takes a step of 2 fs, because no bond vibrates. This page measures small and short runs of SPC/E:
# density, structure, diffusion, dielectric constant, and what the step takes from the temperature of rotation. Errors
# stand with each number. [Longer runs](../rigid-water.md#the-liquid) have smaller ones.

# %%
import tomllib

import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

text = kd.template("water").replace("216", "125").replace("9 angstrom", "7.5 angstrom")
text = text.replace("accuracy = 1e-4", "accuracy = 1e-3")
system = kd.load(tomllib.loads(text))
bath = {"temperature": 298.0, "friction": 2.0}
sim = kd.Simulation(system, "baoab", dt=0.002, **bath)
sim.run(time=4.0)
print(system, "\n", system.constraints)

# %% [markdown]
# ## Density
#
# A barostat moves the centres of molecules at 1 bar. Lennard-Jones forces that end at 7.5 angstrom lack their
# attraction from beyond, so this density is low. The page on rigid water has runs with this tail.

# %%
pressed = kd.Simulation(
    system, "baoab", dt=0.002, **bath, pressure="1 bar", pressure_tau="0.5 ps", compressibility="4.6e-5 bar^-1"
)
pressed.state = system.at(sim.state.phase, 0.0).state
pressed.run(time=2.0)
pressed.run(time=10.0, every=25)
grams = 125 * 18.0154 * 1.66053906660  # g/cm3 times cubic angstrom
density = kd.analysis.block_average([grams / sample.volume for sample in pressed.record.samples[-200:]])
print(f"density {density.value:.3f} +- {density.error:.3f} g/cm3")

# %% [markdown]
# ## Structure, diffusion and the dielectric constant
#
# A run at constant energy does not disturb the motion. Its temperature is that of its start, some kelvin off 298 K,
# and diffusion grows by 2 % with each. A run of 20 ps is too short for an error of the dielectric constant.

# %%
free = kd.Simulation(system, "velocity-verlet", dt=0.002)
free.state = system.at(sim.state.phase, 0.0).state
report = free.run(time=20.0, every=25, output="water.h5md", overwrite=True)
print(report.molecules)
with kd.open("water.h5md") as run:
    rdf = kd.analysis.radial_distribution(run[::4], pair=("O", "O"))
    msd = kd.analysis.mean_squared_displacement(run, lags=60, of="O", remove_drift=True)
    dielectric = kd.analysis.dielectric_constant(run)
    edge, boltzmann = run.box.lengths[0], run.units.boltzmann
small = msd.diffusion(1.0, 2.5)
viscosity = 0.729e-3 * 6.241509  # of SPC/E in eV ps / angstrom^3
wide = small.at_infinite_size(298.0, viscosity, edge, boltzmann)
print(f"first peak of g_OO {rdf.g.max():.2f} at {rdf.r[rdf.g.argmax()]:.2f} angstrom")
print(f"diffusion in this box {small}, in an infinite one {wide}")
print(f"dielectric constant {dielectric.value:.0f} +- {dielectric.error:.0f}")

# %% [markdown]
# ## Equipartition against the step
#
# At whole steps of velocity Verlet rotation looks colder than translation. Forces and torques at one moment tell by how
# much, to leading order: as the square of the step.

# %%
steps = np.array([0.5, 1.0, 2.0, 3.0, 4.0])
lacks = []
for dt in steps:
    short = kd.Simulation(system, "velocity-verlet", dt=1e-3 * dt)
    short.state = system.at(free.state.phase, 0.0).state
    bias = short.run(time=0.2).molecules.step_bias
    lacks.append([bias["translation"], bias["rotation"]])
figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
axes[0].plot(rdf.r, rdf.g)
axes[0].set(title="Oxygen around oxygen", xlabel="r (angstrom)", ylabel="g(r)")
axes[1].errorbar(msd.times, msd.values, np.where(np.isfinite(msd.error), msd.error, 0.0))
axes[1].set(title="Mean squared displacement", xlabel="time (ps)", ylabel="angstrom$^2$")
axes[2].loglog(steps, lacks, "o-", label=["translation", "rotation"])
axes[2].set(title="What the step takes", xlabel="step (fs)", ylabel="temperature (K)")
axes[2].legend()
plt.show()
