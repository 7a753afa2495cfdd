"""Systems of force fields, built by OpenMM and taken by `kd.System.from_openmm`, beside OpenMM's Reference platform.

Each term's energy, the forces, and the positions after 20 steps of velocity Verlet, with constraints kept by both. The
sum over the mesh has the same splitting parameter in both, and meshes so fine that their errors do not count. OpenMM's
dispersion correction averages over N (N + 1) / 2 pairs, each particle with itself among them, and kickdrift's over
N^2 / 2. So it has a claim of its own, in which kickdrift's law is averaged as OpenMM does. With virtual
sites, OpenMM steps by its leapfrog from velocities half a step back, which gives the positions of velocity Verlet:
velocity Verlet as a CustomIntegrator has forces with the sites of the step before. The structures are those in OpenMM's
package.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift_validation.claim import Claim, at_most, main

CUTOFF, SWITCH, ALPHA, FINE = 0.9, 0.75, 2.5, 0.048  # nm, nm, 1/nm, nm: widest mesh
STEPS = 20
TERMS = {  # kickdrift's forces for those of OpenMM
    ("HarmonicBondForce",): ("harmonic-bond",), ("HarmonicAngleForce",): ("harmonic-angle",),
    ("PeriodicTorsionForce",): ("periodic-dihedral", "periodic-improper"),
    ("CustomTorsionForce",): ("harmonic-improper",), ("CMAPTorsionForce",): ("cmap",),
    ("NonbondedForce", "CustomNonbondedForce", "CustomBondForce"): ("lennard-jones", "coulomb", "listed-pairs"),
}  # fmt: skip
PEER = "OpenMM, Reference platform"


def structure(name: str) -> Any:
    """A structure in OpenMM's package."""
    import openmm.app as app

    return app.PDBFile(str(Path(app.__file__).parent / "data" / name))


def peptide(pdb: Any) -> Any:
    """The residues that are neither water nor ions, in open space."""
    import openmm.app as app

    made = app.Modeller(pdb.topology, pdb.positions)
    made.delete([each for each in pdb.topology.residues() if each.name in ("HOH", "CL", "NA", "Cl", "Na")])
    made.topology.setPeriodicBoxVectors(None)
    return made


def built(pdb: Any, files: tuple[str, ...], rigid: bool, **more: Any) -> Any:
    """OpenMM's System: PME with a fine mesh in a periodic box, all pairs in open space."""
    import openmm
    import openmm.app as app

    edges = pdb.topology.getPeriodicBoxVectors()
    pairs = {"nonbondedMethod": app.NoCutoff} if edges is None else {
        "nonbondedMethod": app.PME, "nonbondedCutoff": CUTOFF
    }  # fmt: skip
    pairs |= more
    made = app.ForceField(*files).createSystem(
        pdb.topology, constraints=app.HBonds if rigid else None, rigidWater=rigid, removeCMMotion=False, **pairs
    )
    for k, force in enumerate(made.getForces()):
        force.setForceGroup(k)
        if edges is not None and isinstance(force, openmm.NonbondedForce):
            lengths = [edges[axis][axis]._value for axis in range(3)]
            force.setPMEParameters(ALPHA, *(_mesh(length) for length in lengths))
    return made


def _mesh(length: float) -> int:
    """The next number of points without prime factors above 5, and even, on an edge."""
    return next(n for n in range(2 * int(length / FINE / 2.0) + 2, 1000, 2) if _smooth(n))


def _smooth(n: int) -> bool:
    for factor in (2, 3, 5):
        while n % factor == 0:
            n //= factor
    return n == 1


def verlet(dt: float) -> Any:
    """Velocity Verlet with constraints on positions and velocities, as in OpenMM's manual of CustomIntegrator."""
    import openmm

    made = openmm.CustomIntegrator(dt)
    made.setConstraintTolerance(1e-13)
    made.addPerDofVariable("before", 0.0)
    made.addComputePerDof("v", "v + 0.5*dt*f/m")
    made.addComputePerDof("before", "x")
    made.addComputePerDof("x", "x + dt*v")
    made.addConstrainPositions()
    made.addComputePerDof("v", "(x - before)/dt")
    made.addComputePerDof("v", "v + 0.5*dt*f/m")
    made.addConstrainVelocities()
    return made


def leapfrog(dt: float) -> Any:
    """OpenMM's own leapfrog, with constraints."""
    import openmm

    made = openmm.VerletIntegrator(dt)
    made.setConstraintTolerance(1e-13)
    return made


def over_their_pairs(law: Any, system: kd.System, tail: float) -> float:
    """The energy ``tail`` from beyond the cutoff, averaged over N (N + 1) / 2 pairs in place of N^2 / 2."""
    counts, n = np.bincount(system.species_index), len(system)
    for kind, count in zip(system.species, counts, strict=True):
        alone = SimpleNamespace(dimensions=3, volume=system.volume, species=(kind,), species_index=np.array([0]))
        tail += count * law.tail_corrections(alone)[0]
    return n / (n + 1.0) * tail


def compare(what: str, pdb: Any, files: tuple[str, ...], rigid: bool, **more: Any) -> Iterator[Claim]:
    """Claims of one system."""
    import openmm

    theirs = built(pdb, files, rigid, **more)
    ours = kd.System.from_openmm(theirs, pdb.topology, pdb.positions)
    dt = 0.002 if rigid else 0.0005
    pairs = next(force for force in theirs.getForces() if isinstance(force, openmm.NonbondedForce))
    law = next(force for force in ours.forces if force.name == "lennard-jones")
    tail = law.tail_corrections(ours)[0]
    context = openmm.Context(theirs, verlet(dt), openmm.Platform.getPlatformByName("Reference"))
    context.setPositions(ours.state.positions)

    def energy(kinds: tuple[str, ...]) -> float:
        groups = {force.getForceGroup() for force in theirs.getForces() if type(force).__name__ in kinds}
        return float(context.getState(energy=True, groups=groups).getPotentialEnergy()._value) if groups else 0.0

    kind = type(pairs).__name__
    with_tail = energy((kind,))
    pairs.setUseDispersionCorrection(False)
    context.reinitialize(preserveState=True)
    if tail:
        off = abs(over_their_pairs(law, ours, tail) / (with_tail - energy((kind,))) - 1.0)
        yield at_most(f"{what}: dispersion correction over the same pairs, relative difference", off, 1e-9, PEER)
    for kinds, names in TERMS.items():
        terms = [each for each in ours.forces if each.name in names]
        found = BoundForces(ours.under(terms)).measure(0.0, ours.state.phase).potential if terms else 0.0
        found -= tail if kind in kinds else 0.0
        if expected := energy(kinds):  # rigid water has no bonds that act
            off = abs(found / expected - 1.0)
            yield at_most(f"{what}: energy of {' and '.join(kinds)}, relative difference", off, 1e-6, PEER)
    sim, massive = kd.Simulation(ours, "velocity-verlet", dt=dt), ours.state.masses > 0.0
    pulls = np.array(context.getState(forces=True).getForces(asNumpy=True)._value)[massive]
    off = float(np.sqrt(((sim.forces()[massive] - pulls) ** 2).sum() / (pulls**2).sum()))
    yield at_most(f"{what}: forces, relative RMS difference", off, 1e-5, PEER)
    if not massive.all():
        context = openmm.Context(theirs, leapfrog(dt), openmm.Platform.getPlatformByName("Reference"))
        context.setPositions(ours.state.positions)
        pulls = np.array(context.getState(forces=True).getForces(asNumpy=True)._value)
        back = np.zeros_like(pulls)
        back[massive] = -0.5 * dt * pulls[massive] / ours.state.masses[massive, None]
        context.setVelocities(back)
    sim.run(steps=STEPS)
    context.getIntegrator().step(STEPS)
    moved = np.array(context.getState(positions=True).getPositions(asNumpy=True)._value)
    apart = 10.0 * float(np.abs(sim.state.positions - moved).max())
    yield at_most(f"{what}: positions after {STEPS} steps of {1000 * dt:g} fs, angstrom", apart, 1e-5, PEER)


def claims(long: bool = False) -> Iterator[Claim]:
    """A protein in open space with three force fields, four waters, and with ``long`` the protein in water and a
    membrane."""
    import openmm.app as app

    protein = structure("test.pdb")
    amber = ("amber14-all.xml", "amber14/tip3p.xml")
    yield from compare("protein in open space, amber14", peptide(protein), amber, False)
    yield from compare("the same with CMAP, amber19", peptide(protein), ("amber19-all.xml",), False)
    yield from compare("the same with CMAP and NBFIX, charmm36", peptide(protein), ("charmm36.xml",), False)
    yield from compare("895 TIP3P molecules, rigid", structure("tip3p.pdb"), amber, True)
    switched = {"nonbondedMethod": app.CutoffPeriodic, "switchDistance": SWITCH}
    what = "SPC/E molecules in a reaction field, switched"
    yield from compare(what, structure("spce.pdb"), ("spce.xml",), False, **switched)
    yield from compare("TIP4P-Ew molecules, rigid", structure("tip4pew.pdb"), ("tip4pew.xml",), True)
    if long:
        yield from compare("TIP5P molecules, rigid", structure("tip5p.pdb"), ("tip5p.xml",), True)
        yield from compare("the protein in water, amber99sb, rigid", protein, ("amber99sb.xml", "tip3p.xml"), True)
        charmm = ("charmm36.xml", "charmm36/water.xml")
        yield from compare("POPC in water, charmm36, rigid", structure("POPC.pdb"), charmm, True, switchDistance=SWITCH)


if __name__ == "__main__":
    main(claims, __doc__)
