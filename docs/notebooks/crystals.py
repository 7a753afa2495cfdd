# %% [markdown]
# # A crystal in numbers
#
# Lattice constant, equation of state, elastic constants and the energy of a vacancy say most of what a potential makes
# of a crystal. Here they are for copper and silicon. Each number is a line or two.

# %%
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import curve_fit

import kickdrift as kd
from kickdrift.model.starts.builders import lattice
from kickdrift.systemfile.files import shipped

GPA = 1.0 / 160.2176634  # in eV per cubic angstrom
file = shipped()["copper-864"].with_name("Cu_zhou2004_smooth.eam.alloy")
CRYSTALS = {  # force, lattice, atoms in a cell, cells along an edge, a guess of the lattice constant, mass
    "Cu": (kd.EmbeddedAtom(file), "fcc", 4, 4, 3.61, 63.546),
    "Si": (kd.StillingerWeber(), "diamond", 8, 3, 5.43, 28.0855),
}


def crystal(element, edge=None):
    """The crystal with this lattice constant."""
    force, kind, sites, cells, guess, mass = CRYSTALS[element]
    x, edges = lattice(kind, sites * cells**3, sites / (edge or guess) ** 3)
    return kd.System(x, masses=mass, box=edges, forces=[force], units="metal", species=[element] * len(x))


# %% [markdown]
# ## Equation of state
#
# `system.energy()` needs neither an integrator nor a step. Birch and Murnaghan's curve through the energies of nine
# volumes gives the lattice constant, the bulk modulus and how it grows under pressure.


# %%
def birch(volume, energy, volume_0, bulk, slope):
    """Birch 1947, doi:10.1103/PhysRev.71.809."""
    ratio = (volume_0 / volume) ** (2 / 3)
    return energy + 9 / 16 * volume_0 * bulk * ((ratio - 1) ** 3 * slope + (ratio - 1) ** 2 * (6 - 4 * ratio))


curves, perfect = {}, {}
for element, (_, _, sites, _, guess, _) in CRYSTALS.items():
    edges = guess * np.linspace(0.97, 1.03, 9) ** (1 / 3)
    systems = [crystal(element, edge) for edge in edges]
    energies = np.array([each.energy().potential / len(each) for each in systems])
    volumes = edges**3 / sites
    found, _ = curve_fit(birch, volumes, energies, p0=(energies.min(), volumes[4], 100 * GPA, 4.0))
    edge = (sites * found[1]) ** (1 / 3)
    curves[element], perfect[element] = (volumes, energies, found), crystal(element, edge)
    print(
        f"{element}: a = {edge:.4f} angstrom, E = {found[0]:.4f} eV, B = {found[2] / GPA:.1f} GPa, B' = {found[3]:.2f}"
    )

# %% [markdown]
# ## Elastic constants
#
# `elastic_constants` strains the crystal, relaxes the atoms and takes the slope of the stress. The command
# `kickdrift relax crystal.toml --strain 0.001` does the same. In silicon the atoms of a cell move against each other.
# So C44 is half of what it would be without relaxation.

# %%
moduli = {element: kd.analysis.elastic_constants(system) for element, system in perfect.items()}
for element, found in moduli.items():
    c11, c12, c44 = np.array(found.cubic) / found.gigapascal
    print(f"{element}: C11 = {c11:.1f}, C12 = {c12:.1f}, C44 = {c44:.1f} GPa; A = {2 * c44 / (c11 - c12):.2f}")
moduli["Si"]

# %% [markdown]
# ## A vacancy
#
# One atom leaves, and its neighbours relax. The energy of formation is what the crystal with N - 1 atoms has more than
# N - 1 atoms of the perfect crystal. In silicon the neighbours' own sites are a shallow minimum. A picosecond at 1000 K
# leads to a deeper one.

# %%
for element, whole in perfect.items():
    x = whole.state.positions[1:]
    left = kd.System(
        x, masses=whole.state.masses[1:], box=whole.box, forces=whole.forces, units="metal", species=[element] * len(x)
    )  # fmt: skip
    per_atom = whole.energy().potential / len(whole)
    at_sites = left.energy().potential - per_atom * len(left)
    warm = left.with_velocities(temperature=1000.0, seed=1)
    hot = kd.Simulation(warm, "baoab", "1 fs", temperature=1000.0, friction=1.0, seed=1)
    hot.run(1000)
    near, deep = (kd.Simulation(each).minimize().energy - per_atom * len(left) for each in (left, hot.now()))
    print(
        f"{element}: {at_sites:.3f} eV on the sites, {near:.3f} eV at the nearest minimum, {deep:.3f} eV after 1000 K"
    )

# %%
figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
for (element, (volumes, energies, found)), marker in zip(curves.items(), "os", strict=True):
    fine = np.linspace(volumes[0], volumes[-1], 100)
    (line,) = axes[0].plot(fine / found[1], 1000 * (birch(fine, *found) - found[0]), label=element)
    axes[0].plot(volumes / found[1], 1000 * (energies - found[0]), marker, color=line.get_color())
axes[0].set(xlabel="volume over that of zero pressure", ylabel="energy (meV per atom)", title="Equation of state")
axes[0].legend()
names = ("C11", "C12", "C44")
for k, (element, found) in enumerate(moduli.items()):
    axes[1].bar(np.arange(3) + 0.4 * k, np.array(found.cubic) / found.gigapascal, width=0.35, label=element)
axes[1].set(xticks=np.arange(3) + 0.2, xticklabels=names, ylabel="GPa", title="Elastic constants")
plt.show()
