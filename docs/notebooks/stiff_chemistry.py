# %% [markdown]
# # Stiff chemistry
#
# Robertson's three reactions have rates from 0.04 to 30 million. An explicit method must follow the fastest rate,
# although nothing happens at that speed, while an implicit method takes steps as long as the slow reactions allow.

# %%
import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

problem = kd.load("ode-robertson")
print(problem)

# %% [markdown]
# Two implicit methods and one explicit method go to time 40 with the same accuracy. Compare their steps.

# %%
for method in ("radau", "bdf", "dop853"):
    report = kd.Simulation(problem, method, rtol=1e-6, atol=1e-10).run(until=40.0)
    print(f"{method:8} {report.steps:>7} steps")

# %% [markdown]
# Radau goes on to time 10 million with a few hundred steps.


# %%
def robertson(t, y):
    slow, fast = 0.04 * y[0] - 1e4 * y[1] * y[2], 3e7 * y[1] ** 2
    return [-slow, slow - fast, fast]


times = np.logspace(-5, 7, 200)
found = kd.solve(robertson, (0, 1e7), [1.0, 0.0, 0.0], method="Radau", t_eval=times, rtol=1e-8, atol=1e-12)
print(found.message, found.nfev)
print("sum of the concentrations is off by", np.abs(found.y.sum(axis=0) - 1).max())

# %%
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
for values, name, scale in zip(found.y, "ABC", (1, 1e4, 1), strict=True):
    axes.semilogx(times, values * scale, label=f"{name}" if scale == 1 else f"{name} x {scale:g}")
axes.set(title="Robertson's reactions", xlabel="time", ylabel="concentration")
axes.legend()
plt.show()
