# %% [markdown]
# # Write your own integrator
#
# A splitting method is a row of weights for kicks and drifts. Register the row, and the method runs compiled on every
# system, with files, restarts and the same bits.

# %%
import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

# %% [markdown]
# McLachlan and Atela's optimal method of second order has two stages.

# %%
z = 0.5**0.5
kd.register_splitting(
    "mclachlan-atela2",
    kick=[z, 1 - z],
    drift=[1 - z, z],
    first="drift",
    order=2,
    source="McLachlan & Atela 1992, Nonlinearity 5, 541, doi:10.1088/0951-7715/5/2/011",
    use="second order, small error",
)

# %% [markdown]
# A Runge-Kutta method is its tableau.

# %%
kd.register_tableau("heun", a=[[1.0]], b=[0.5, 0.5], order=2, source="Heun 1900, Z. Math. Phys. 45, 23", use="teaching")

# %% [markdown]
# Measure the order: the error after one period of an ellipse falls as the square of the step. Equal cost is a fair
# comparison, so the error stands against the number of force evaluations.

# %%
kepler = kd.load("kepler-e09")
period = kepler.invariants["period"]
methods = {"leapfrog": 1, "mclachlan-atela2": 2, "heun": 2, "pefrl": 4}  # force evaluations of a step
errors = {}
for method, cost in methods.items():
    errors[method] = []
    for evaluations in (4000, 8000, 16000, 32000):
        sim = kd.Simulation(kepler, method, dt=period * cost / evaluations)
        start = sim.state.positions.copy()
        sim.run(evaluations // cost)
        errors[method].append((evaluations, np.abs(sim.state.positions - start).max()))
    slope = np.polyfit(*np.log(np.array(errors[method])).T, 1)[0]
    print(f"{method:18} error falls with the power {-slope:.2f} of the cost")

# %%
figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
for method, values in errors.items():
    axes.loglog(*np.array(values).T, "o-", label=method)
axes.set(title="One turn of an ellipse of eccentricity 0.9", xlabel="force evaluations", ylabel="error of the position")
axes.legend()
plt.show()
