# %% [markdown]
# # Heat baths
#
# A heat bath keeps a liquid at a temperature. Some baths disturb the motion little, and some make particles forget
# their velocities fast, but all must give the right distribution of the kinetic energy.

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import gamma

import kickdrift as kd

system = kd.load("lj-1000")
baths = {
    "baoab": {"friction": 1.0},
    "nose-hoover": {"tau": 0.5},
    "csvr": {"tau": 0.5},
    "andersen": {"collision_rate": 1.0},
}

# %% [markdown]
# Each run begins as a lattice at the wrong temperature. Friction, `tau` and the collision rate set how fast the bath
# acts.

# %%
temperatures = {}
for bath, options in baths.items():
    sim, seen = kd.Simulation(system, bath, dt=0.005, temperature=1.0, **options), []
    sim.equilibrate(1.0, time=10.0)
    sim.run(2500, every=5, observe=lambda s, seen=seen: seen.append((s.time, 2 * s.energy().kinetic / (3 * 999))))
    temperatures[bath] = np.array(seen)
    mean = kd.analysis.block_average(temperatures[bath][:, 1])
    print(f"{bath:12} {mean.value:.4f} +- {mean.error:.4f}")

# %% [markdown]
# A box of 1000 particles has no exact temperature at any moment. The kinetic energy follows a gamma distribution,
# whose width shrinks with the number of particles.

# %%
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for bath, values in temperatures.items():
    axes[0].plot(values[:, 0], values[:, 1], linewidth=0.8, label=bath)
    axes[1].hist(values[:, 1], bins=25, density=True, histtype="step", label=bath)
t = np.linspace(0.9, 1.1, 200)
axes[1].plot(t, gamma.pdf(t, 1.5 * 999, scale=1 / (1.5 * 999)), color="black", label="exact")
axes[0].set(title="Instantaneous temperature", xlabel="time (tau)")
axes[1].set(title="Its distribution", xlabel="temperature")
axes[1].legend(fontsize=8)
plt.show()
