# %% [markdown]
# # Maps of chaos
#
# Hénon and Heiles asked in 1964 whether a star in a galaxy keeps a third integral. At low energy every orbit is
# regular. At energy 1/8 regular and chaotic orbits share the plane. Two near starts tell which kind an orbit is: their
# distance grows in proportion to time on a regular orbit, and exponentially on a chaotic orbit.

# %%
import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

ENERGY, CELLS, NEAR, LENGTH = 1 / 8, 80, 1e-9, 400.0

# %% [markdown]
# The map shows the plane x = 0. A point of the plane is a start: the energy sets the velocity along x. Each start has a
# neighbour at a distance of 1e-9.

# %%
y, vy = (each.ravel() for each in np.meshgrid(np.linspace(-0.45, 0.7, CELLS), np.linspace(-0.52, 0.52, CELLS)))
twice = 2 * ENERGY - vy**2 - y**2 + 2 / 3 * y**3
allowed = twice > 0
y, vy, vx = y[allowed], vy[allowed], np.sqrt(twice[allowed])
starts = np.array([np.zeros_like(y), y, vx, vy])
both = np.concatenate([starts, starts + np.array([[0.0], [NEAR], [0.0], [0.0]])], axis=1)
print(both.shape[1], "orbits")


# %% [markdown]
# All orbits are one system of equations, which kickdrift compiles once.


# %%
def henon_heiles(t, state):
    n = state.size // 4
    x, y = state[:n], state[n : 2 * n]
    rate = np.empty_like(state)
    rate[: 2 * n] = state[2 * n :]
    rate[2 * n : 3 * n] = -x - 2 * x * y
    rate[3 * n :] = -y - x * x + y * y
    return rate


sim = kd.Simulation(kd.Problem(henon_heiles, both.ravel()), "rk4", dt=0.05)
sim.run(until=LENGTH, every=2000)
end = sim.state.y.reshape(4, 2, -1)
apart = np.linalg.norm(end[:, 1] - end[:, 0], axis=0)
growth = np.log10(apart / NEAR)
print(f"{np.mean(growth > 5):.0%} of the orbits are chaotic")

# %% [markdown]
# Dark cells are islands of regular orbits. The bright sea is one chaotic orbit, which comes near all points of the sea.
# `kickdrift ensemble SYSTEM --vary … --measure megno` makes such maps of planets, on all cores.

# %%
chaos = np.full(allowed.shape, np.nan)
chaos[allowed] = growth
figure, axes = plt.subplots(figsize=(6.6, 5), layout="constrained")
image = axes.imshow(
    chaos.reshape(CELLS, CELLS), origin="lower", extent=(-0.45, 0.7, -0.52, 0.52), aspect="auto", cmap="inferno"
)
axes.set(title="Hénon and Heiles at energy 1/8", xlabel="y", ylabel="velocity along y")
figure.colorbar(image, label="powers of ten by which neighbours move apart")
plt.show()
