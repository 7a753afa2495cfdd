# %% [markdown]
# # The first hour: from Euler to chaos
#
# A simulation needs three things: what moves, which forces act, and how to step in time. This notebook goes from a
# mass on a spring to a liquid, to planets, and to chaos.

# %%
import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

# %% [markdown]
# ## Euler and Verlet
#
# A mass on a spring should trace an ellipse. Forward Euler spirals outwards, because each step adds energy. Velocity
# Verlet costs one force a step, as Euler does, and stays on a closed curve.

# %%
spring = kd.load("ode-harmonic")
paths = {}
for method in ("euler", "velocity-verlet"):
    sim, seen = kd.Simulation(spring, method, dt=0.1), []
    report = sim.run(200, every=1, observe=lambda s, seen=seen: seen.append(s.state.y.copy()))
    paths[method] = np.array(seen)
    print(f"{method:16} largest relative energy error {report.energy.max_relative_error:.2g}")

# %% [markdown]
# ## A liquid
#
# The same method moves 1000 Lennard-Jones particles. `lj-1000` ships with kickdrift. The lattice melts first, and the
# report then says how well the run kept its energy.

# %%
sim = kd.Simulation(kd.load("lj-1000"), "velocity-verlet", dt=0.005)
sim.equilibrate(temperature=1.0, time=2.0)
report = sim.run(1000)
print(report)

# %% [markdown]
# ## Planets
#
# Planets move on near ellipses. A Wisdom-Holman map follows the ellipses exactly and kicks only for what the planets
# do to each other, so its steps are long.

# %%
sim = kd.Simulation(kd.load("two-planets"), "wisdom-holman", dt=0.25)
report = sim.run(until=1000.0)
print(report.energy.max_relative_error)
print(sim.elements("jacobi"))

# %% [markdown]
# ## Chaos
#
# Lorenz' model of the weather runs from two starts that differ by one part in a hundred million. Their distance grows
# exponentially until the motions have nothing in common. No step and no method changes this growth.


# %%
def lorenz(t, y):
    return [10 * (y[1] - y[0]), y[0] * (28 - y[2]) - y[1], y[0] * y[1] - 8 / 3 * y[2]]


times = np.linspace(0, 40, 2001)
here = kd.solve(lorenz, (0, 40), [1.0, 1.0, 20.0], t_eval=times, rtol=1e-11, atol=1e-11)
there = kd.solve(lorenz, (0, 40), [1.0 + 1e-8, 1.0, 20.0], t_eval=times, rtol=1e-11, atol=1e-11)
apart = np.linalg.norm(here.y - there.y, axis=0)
print(kd.megno(kd.Problem(lorenz, [1.0, 1.0, 20.0]), time=100.0))

# %%
figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
for method, path in paths.items():
    axes[0].plot(path[:, 0], path[:, 1], label=method)
axes[0].set(title="A mass on a spring", xlabel="position", ylabel="velocity", aspect="equal")
axes[0].legend(loc="upper right", fontsize=8)
axes[1].plot(here.y[0], here.y[2], linewidth=0.6)
axes[1].set(title="Lorenz' attractor", xlabel="x", ylabel="z")
axes[2].semilogy(times, apart)
axes[2].set(title="Two starts move apart", xlabel="time", ylabel="distance")
plt.show()
