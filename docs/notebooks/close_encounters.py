# %% [markdown]
# # Close encounters
#
# A Wisdom-Holman map takes long steps while planets stay apart, but its error is large where two planets meet. `trace`
# hands the encounter to a method of high order, and takes the long steps everywhere else.

# %%
import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

bodies = [
    {"name": "star", "mass": 1.0},
    {"name": "inner", "mass": 1e-3, "a": 1.0, "e": 0.05, "M": 0.0},
    {"name": "outer", "mass": 1e-3, "a": 1.25, "e": 0.05, "omega": 170.0, "M": 200.0},
]
system = kd.System.from_elements(bodies)

# %% [markdown]
# Two planets of Jupiter's mass, 2.5 Hill radii apart, are too near to be stable (Gladman 1993). They meet within some
# orbits. Each method takes the same long step.

# %%
series, paths = {}, {}
for method in ("wisdom-holman", "trace"):
    sim, seen, path = kd.Simulation(system, method, dt=0.01), [], []

    def look(s, seen=seen, path=path):
        seen.append((s.time, s.energy().total))
        path.append(s.state.positions - s.state.positions[0])

    sim.run(until=100.0, every=5, observe=look)
    series[method], paths[method] = np.array(seen), np.array(path)
    worst = np.abs(series[method][:, 1] / series[method][0, 1] - 1).max()
    print(f"{method:14} largest relative energy error {worst:.1e}")

# %%
distance = np.linalg.norm(paths["trace"][:, 1] - paths["trace"][:, 2], axis=1)
print(f"closest sample: {distance.min():.3f} AU")
figure, axes = plt.subplots(1, 3, figsize=(12.5, 3.8), layout="constrained")
for k, name in ((1, "inner"), (2, "outer")):
    axes[0].plot(paths["trace"][:, k, 0], paths["trace"][:, k, 1], linewidth=0.5, label=name)
axes[0].plot(0, 0, "*", color="orange", markersize=12)
axes[0].set(title="Orbits with trace", xlabel="x (AU)", ylabel="y (AU)", aspect="equal")
axes[0].legend(fontsize=8)
axes[1].semilogy(series["trace"][:, 0], distance)
axes[1].set(title="Distance of the planets", xlabel="time (years)", ylabel="AU")
for method, values in series.items():
    axes[2].semilogy(values[:, 0], np.abs(values[:, 1] / values[0, 1] - 1) + 1e-16, label=method)
axes[2].set(title="Relative energy error", xlabel="time (years)")
axes[2].legend(fontsize=8)
plt.show()
