# %% [markdown]
# # Structure and diffusion of a liquid
#
# A liquid has no lattice, but its neighbours have a favourite distance. The radial distribution function g(r) shows
# this order, and the mean squared displacement shows how fast particles wander.

# %%
import matplotlib.pyplot as plt

import kickdrift as kd

sim = kd.Simulation(kd.load("lj-1000"), dt=0.005)
sim.equilibrate(temperature=0.9, time=3.0)
report = sim.run(3000, every=10, output="structure.h5md", overwrite=True)
print(report.temperature, report.pressure)

# %% [markdown]
# The file keeps frames. Every analysis has an error bar from independent parts of the run.

# %%
with kd.open("structure.h5md") as run:
    rdf = kd.analysis.radial_distribution(run[::5], r_max=4.0)
    msd = kd.analysis.mean_squared_displacement(run, lags=60)
    vacf = kd.analysis.velocity_autocorrelation(run)
einstein, green_kubo = msd.diffusion(0.5, 0.9), vacf.diffusion(until=1.5)
print(f"first peak at r = {rdf.r[rdf.g.argmax()]:.2f}, height {rdf.g.max():.2f}")
print(f"diffusion by Einstein   {einstein.value:.4f} +- {einstein.error:.4f}")
print(f"diffusion by Green-Kubo {green_kubo.value:.4f} +- {green_kubo.error:.4f}")

# %% [markdown]
# Both ways to the diffusion coefficient agree within their errors. The velocity autocorrelation function turns
# negative: neighbours form a cage that throws a particle back.

# %%
figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
axes[0].plot(rdf.r, rdf.g)
axes[0].set(title="Radial distribution", xlabel="r (sigma)", ylabel="g(r)")
axes[1].errorbar(msd.times, msd.values, msd.error)
axes[1].set(title="Mean squared displacement", xlabel="time (tau)", ylabel="sigma$^2$")
axes[2].plot(vacf.times, vacf.normalised)
axes[2].axhline(0, color="grey", linewidth=0.8)
axes[2].set(title="Velocity autocorrelation", xlabel="time (tau)", xlim=(0, 1.5))
plt.show()
