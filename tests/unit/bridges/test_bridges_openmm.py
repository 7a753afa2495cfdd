"""Systems from OpenMM: energies by term, forces and steps beside OpenMM's Reference platform, and refusals."""

import numpy as np
import openmm
import openmm.app as app
import pytest
from openmm import unit

import kickdrift as kd
from kickdrift.bridges.openmm.files import Asked, read
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.molecules.relatives import measured
from kickdrift.systemfile.reading import loads
from tests.long import rest

REFERENCE = openmm.Platform.getPlatformByName("Reference")
ALANINE = """\
ATOM      1 HH31 ACE A   1       2.000   1.000   0.000
ATOM      2  CH3 ACE A   1       2.000   2.090   0.000
ATOM      3 HH32 ACE A   1       1.486   2.454   0.890
ATOM      4 HH33 ACE A   1       1.486   2.454  -0.890
ATOM      5  C   ACE A   1       3.427   2.641   0.000
ATOM      6  O   ACE A   1       4.391   1.877   0.000
ATOM      7  N   ALA A   2       3.555   3.970   0.000
ATOM      8  H   ALA A   2       2.733   4.556   0.000
ATOM      9  CA  ALA A   2       4.853   4.614   0.000
ATOM     10  HA  ALA A   2       5.408   4.316   0.890
ATOM     11  CB  ALA A   2       5.661   4.221  -1.232
ATOM     12  HB1 ALA A   2       5.123   4.521  -2.131
ATOM     13  HB2 ALA A   2       6.630   4.719  -1.206
ATOM     14  HB3 ALA A   2       5.809   3.141  -1.241
ATOM     15  C   ALA A   2       4.713   6.129   0.000
ATOM     16  O   ALA A   2       3.601   6.653   0.000
ATOM     17  N   NME A   3       5.846   6.835   0.000
ATOM     18  H   NME A   3       6.737   6.359   0.000
ATOM     19  C   NME A   3       5.846   8.284   0.000
ATOM     20  H1  NME A   3       4.819   8.648   0.000
ATOM     21  H2  NME A   3       6.360   8.648   0.890
ATOM     22  H3  NME A   3       6.360   8.648  -0.890
TER
END
"""


@pytest.fixture(scope="module")
def alanine(tmp_path_factory):
    """Topology and shaken positions (nm) of alanine dipeptide."""
    path = tmp_path_factory.mktemp("openmm") / "alanine.pdb"
    path.write_text(ALANINE, encoding="utf-8")
    pdb = app.PDBFile(str(path))
    x = pdb.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    return pdb.topology, x + np.random.default_rng(3).uniform(-0.004, 0.004, x.shape)


def with_sites(topology, x, sites):
    """OpenMM's topology and positions of water with one more place for each molecule."""
    made = app.Modeller(topology, x * unit.nanometer)
    made.addExtraParticles(app.ForceField(sites))
    return made.topology, np.array(made.positions.value_in_unit(unit.nanometer))


@pytest.fixture(scope="module")
def water():
    """Topology and positions (nm) of 64 molecules of TIP3P on a lattice, turned at random, in a box of 1.25 nm."""
    topology, rng = app.Topology(), np.random.default_rng(4)
    chain, places = topology.addChain(), []
    arms = 0.09572 * np.array([[0.0, 0.0], [1.0, 0.0], [np.cos(np.radians(104.52)), np.sin(np.radians(104.52))]])
    for site in np.indices((4, 4, 4)).reshape(3, -1).T * 0.3125:
        residue = topology.addResidue("HOH", chain)
        oxygen, *hydrogen = (
            topology.addAtom(name, app.Element.getBySymbol(name[0]), residue) for name in ("O", "H1", "H2")
        )
        for each in hydrogen:
            topology.addBond(oxygen, each)
        plane = np.linalg.qr(rng.normal(size=(3, 2)))[0]
        places.append(site + arms @ plane.T)
    topology.setPeriodicBoxVectors(1.25 * np.eye(3) * unit.nanometer)
    return topology, np.concatenate(places)


def built(topology, *files, **more):
    return app.ForceField(*files).createSystem(topology, removeCMMotion=False, **more)


def context_of(system, x, dt=0.0005):
    """A Context on the Reference platform, with a group for each force."""
    for k, force in enumerate(system.getForces()):
        force.setForceGroup(k)
    context = openmm.Context(system, openmm.VerletIntegrator(dt), REFERENCE)
    context.setPositions(x)
    return context


def energies_of(context, system):
    """Energy of each force of OpenMM, by the name of its class."""
    found = {}
    for k, force in enumerate(system.getForces()):
        energy = context.getState(energy=True, groups={k}).getPotentialEnergy()
        found[type(force).__name__] = energy.value_in_unit(unit.kilojoule_per_mole)
    return found


TERMS = {
    "HarmonicBondForce": ("harmonic-bond",), "HarmonicAngleForce": ("harmonic-angle",),
    "PeriodicTorsionForce": ("periodic-dihedral", "periodic-improper"), "RBTorsionForce": ("ryckaert-bellemans",),
    "NonbondedForce": ("lennard-jones", "coulomb", "listed-pairs"), "CMAPTorsionForce": ("cmap",),
}  # fmt: skip


def assert_alike(theirs, ours, energy, force):
    """Compare energies by term and forces, relative to theirs."""
    context = context_of(theirs, ours.state.positions)
    for name, expected in energies_of(context, theirs).items():
        terms = [each for each in ours.forces if each.name in TERMS[name]]
        found = BoundForces(ours.under(terms)).measure(0.0, ours.state.phase).potential if terms else 0.0
        assert found == pytest.approx(expected, rel=energy, abs=1e-9), name
    expected = context.getState(forces=True).getForces(asNumpy=True)
    expected = expected.value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
    found = kd.Simulation(ours, dt=0.0005).forces()
    assert np.sqrt(((found - expected) ** 2).sum() / (expected**2).sum()) < force


def assert_same_steps(theirs, ours):
    """Compare positions after 20 steps with OpenMM's Verlet, whose velocities are half a step behind."""
    dt = 0.0005
    run = kd.Simulation(ours, integrator="velocity-verlet", dt=dt)
    run.run(steps=20)
    start = kd.Simulation(ours, dt=dt)
    context = context_of(theirs, ours.state.positions, dt)
    a = start.forces() / ours.state.masses[:, None]
    context.setVelocities(ours.state.velocities - 0.5 * dt * a)
    context.getIntegrator().step(20)
    expected = context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    assert np.abs(run.state.positions - expected).max() < 1e-6


def test_alanine_dipeptide_in_open_space_is_that_of_openmm(alanine):
    topology, x = alanine
    theirs = built(topology, "amber14-all.xml")
    ours = kd.System.from_openmm(theirs, topology, x)
    assert [force.name for force in ours.forces].count("periodic-dihedral") == 3
    assert len(ours.topology.impropers) == 4
    assert "force             HarmonicAngle(types={11 types}, " in str(ours)
    assert_alike(theirs, ours, 1e-8, 1e-8)
    assert_same_steps(theirs, ours)


def test_maps_of_two_dihedrals_are_those_of_openmm(alanine):
    topology, x = alanine
    theirs = built(topology, "amber19-all.xml")
    ours = kd.System.from_openmm(theirs, topology, x)
    assert str(ours.forces[-1]) == "Cmap(1 terms, 16 maps of 24 x 24)"
    assert_alike(theirs, ours, 1e-8, 1e-8)
    again = kd.System.from_openmm(*ours.to_openmm())
    assert again.forces[-1] == ours.forces[-1]


@pytest.mark.long
def test_charmm36_in_openmms_custom_forces_is_that_of_openmm(alanine):
    """Lennard-Jones by pairs of types, 1-4 pairs as bonds, and CMAP."""
    topology, x = alanine
    theirs = built(topology, "charmm36_2024.xml")
    ours = kd.System.from_openmm(theirs, topology, x)
    energies = energies_of(context_of(theirs, x), theirs)
    names = {force.name for force in ours.forces}
    assert {"lennard-jones", "listed-pairs", "cmap"} <= names
    found = BoundForces(ours).measure(0.0, ours.state.phase).potential
    assert found == pytest.approx(sum(energies.values()), rel=1e-8)
    expected = context_of(theirs, x).getState(forces=True).getForces(asNumpy=True)._value
    found = kd.Simulation(ours, dt=0.0005).forces()
    assert np.sqrt(((found - expected) ** 2).sum() / (expected**2).sum()) < 1e-8


def custom(kind, formula, values):
    """OpenMM's System of four particles with one item of a custom force, or all pairs, and their places."""
    theirs, force = openmm.System(), getattr(openmm, f"Custom{kind}Force")(formula)
    per = "Particle" if kind == "Nonbonded" else kind
    for key in values:
        getattr(force, f"addPer{per}Parameter")(key)
    for _ in range(4):
        theirs.addParticle(12.0)
        if kind == "Nonbonded":
            force.addParticle([*values.values()])
    if kind != "Nonbonded":
        items = {"Bond": (0, 3), "Angle": (0, 1, 2), "Torsion": (0, 1, 2, 3)}[kind]
        getattr(force, f"add{kind}")(*items, [*values.values()])
    theirs.addForce(force)
    return theirs, np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.15, 0.1, 0.0], [0.2, 0.1, 0.03]])


@pytest.mark.parametrize(
    ("kind", "formula", "values", "law"),
    [
        ("Bond", "a*(r-b)*(r-b)", {"a": 900.0, "b": 0.13}, "harmonic-bond"),
        ("Bond", "c/r^12 - d/r^6 + q/r", {"c": 1e-6, "d": 2e-3, "q": -3.0}, "listed-pairs"),
        ("Angle", "k*(pi-theta)^2; pi=3.14159265358979", {"k": 40.0}, "harmonic-angle"),
        ("Angle", "k + k*cos(theta)", {"k": 40.0}, "cosine-angle"),
        ("Torsion", "k*cos(theta)^3 + b*sin(2*theta)", {"k": 4.0, "b": 1.5}, "periodic-improper"),
    ],
)
def test_a_custom_force_is_the_law_with_its_energies(kind, formula, values, law):
    theirs, x = custom(kind, formula, values)
    ours = kd.System.from_openmm(theirs, None, x)
    assert {force.name for force in ours.forces} == {law}
    back, _, x, _ = ours.to_openmm()
    context = context_of(theirs, x)
    (expected,) = energies_of(context, theirs).values()
    assert sum(energies_of(context_of(back, x), back).values()) == pytest.approx(expected, rel=1e-8)
    assert BoundForces(ours).measure(0.0, ours.state.phase).potential == pytest.approx(expected, rel=1e-8)
    pulls = context.getState(forces=True).getForces(asNumpy=True)._value
    np.testing.assert_allclose(kd.Simulation(ours, dt=0.0005).forces(), pulls, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "formula", "values", "law"),
    [
        ("Bond", "a*(r-b)^4 + depth*(1-exp(-w*(r-b)))^2", {"a": 9.0, "b": 0.1, "w": 20.0}, "formula-bond"),
        rest("Bond", "a*max(0,r-b)^2", {"a": 9e3, "b": 0.15}, "formula-bond"),
        rest("Angle", "a*(cos(theta)-cos(b))^2 + tan(0.3*theta)", {"a": 90.0, "b": 2.0}, "formula-angle"),
        rest(
            "Torsion", "k*min(d,2*pi-d)^2; d=abs(theta-t0); pi=3.1415926535", {"k": 30.0, "t0": 0.7}, "formula-improper"
        ),
        ("Torsion", "k*exp(-a*(1-cos(theta-0.3)))", {"k": 30.0, "a": 0.7}, "formula-improper"),
    ],
)
def test_a_custom_force_of_any_formula_is_that_of_openmm(kind, formula, values, law):
    theirs, x = custom(kind, formula, values)
    if "depth" in formula:
        theirs.getForce(0).addGlobalParameter("depth", 7.0)
    ours = kd.System.from_openmm(theirs, None, x)
    assert {force.name for force in ours.forces} == {law}
    back, _, x, _ = ours.to_openmm()
    context = context_of(theirs, x)
    (expected,) = energies_of(context, theirs).values()
    assert sum(energies_of(context_of(back, x), back).values()) == pytest.approx(expected, rel=1e-13)
    assert BoundForces(ours).measure(0.0, ours.state.phase).potential == pytest.approx(expected, rel=1e-8)
    pulls = context.getState(forces=True).getForces(asNumpy=True)._value
    np.testing.assert_allclose(kd.Simulation(ours, dt=0.0005).forces(), pulls, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("beside", [rest(True), False])
def test_pairs_of_any_formula_are_those_of_openmm(beside, water):
    """The exponential-6 law of Buckingham by mixed parameters, and screened charges, switched."""
    topology, x = water
    theirs = openmm.System()
    theirs.setDefaultPeriodicBoxVectors(*(1.25 * np.eye(3)))
    formula = "a*exp(-b*r) - c/r^6 + 138.9*q1*q2/r*exp(-kappa*r); a=sqrt(a1*a2); b=0.5*(b1+b2); c=sqrt(c1*c2)"
    own, plain = openmm.CustomNonbondedForce(formula), openmm.NonbondedForce()
    own.addGlobalParameter("kappa", 3.0)
    for key in ("a", "b", "c", "q"):
        own.addPerParticleParameter(key)
    for atom in topology.atoms():
        oxygen = atom.element.symbol == "O"
        theirs.addParticle(16.0 if oxygen else 1.0)
        own.addParticle([2e5, 35.0, 2e-3, -0.8] if oxygen else [5e3, 38.0, 1e-5, 0.4])
        plain.addParticle(-0.8 if oxygen else 0.4, 0.3, 0.6 if oxygen else 0.0)
    for molecule in range(0, len(x), 3):
        for i, j in ((0, 1), (0, 2), (1, 2)):
            own.addExclusion(molecule + i, molecule + j)
            plain.addException(molecule + i, molecule + j, 0.0, 1.0, 0.0)
    for force in (own, plain) if beside else (own,):
        force.setNonbondedMethod(2)
        force.setCutoffDistance(0.6)
        theirs.addForce(force)
    own.setUseSwitchingFunction(True)
    own.setSwitchingDistance(0.5)
    ours = kd.System.from_openmm(theirs, topology, x)
    (law,) = [force for force in ours.forces if force.name == "formula-pair"]
    context = context_of(theirs, x)
    expected = energies_of(context, theirs)["CustomNonbondedForce"]
    alone = ours.under([law])
    assert BoundForces(alone).measure(0.0, ours.state.phase).potential == pytest.approx(expected, rel=1e-8)
    pulls = context.getState(forces=True, groups={0}).getForces(asNumpy=True)._value
    found = kd.Simulation(alone, dt=0.0005).forces()
    assert np.sqrt(((found - pulls) ** 2).sum() / (pulls**2).sum()) < 1e-8
    back, _, x, _ = alone.to_openmm()
    assert sum(energies_of(context_of(back, x), back).values()) == pytest.approx(expected, rel=1e-12)


def test_pairs_of_species_with_parameters_of_their_own_go_to_openmm():
    table = {("A", "B"): {"epsilon": 0.7, "sigma": 0.4}}
    several = [kd.LennardJones(0.5, 0.3, pairs=table, cutoff=1.0), kd.LennardJones(2.0, 0.2, cutoff=0.8)]
    ours = kd.System([[0, 0, 0], [0.5, 0, 0]], masses=1.0, species=["A", "B"], units="gromacs", forces=several)
    theirs, _, x, _ = ours.to_openmm()
    laws = [(force.pair_law("A", "B").law, force.cutoff) for force in several]
    energy = sum(law(0.25)[0] - law(cutoff**2)[0] for law, cutoff in laws)
    found = context_of(theirs, x).getState(energy=True).getPotentialEnergy()._value
    assert found == pytest.approx(energy, rel=1e-14)


def test_custom_forces_without_a_law_are_named():
    for kind, formula, values, match in (
        ("Bond", "a*erf(r)", {"a": 9.0}, r"CustomBondForce 'a\*erf\(r\)': function 'erf' is not there"),
        ("Nonbonded", "a1*a2*floor(r*10)", {"a": 9.0}, "CustomNonbondedForce 'a1.*: function 'floor' is not there"),
    ):
        theirs, x = custom(kind, formula, values)
        refused(theirs, None, x, match)
    theirs, x = custom("Nonbonded", "a1*a2*exp(-r)", {"a": 9.0})
    plain = openmm.NonbondedForce()
    for _ in range(4):
        plain.addParticle(0.0, 1.0, 0.0)
    theirs.addForce(plain)
    theirs.getForce(0).addExclusion(0, 2)
    refused(theirs, None, x, r"it leaves out the pair \[0, 2\], and NonbondedForce does not")
    theirs.getForce(0).addInteractionGroup([0, 1], [2, 3])
    refused(theirs, None, x, "kickdrift has no interaction groups")


def test_a_system_goes_to_gromacs_and_back(alanine, tmp_path):
    topology, x = alanine
    theirs = built(topology, "amber14-all.xml")
    ours = kd.System.from_openmm(theirs, topology, x)
    files = ours.to_gromacs(tmp_path / "alanine.top")
    assert [each.name for each in files] == ["alanine.top", "alanine.gro"]
    again = kd.load(files.top, coordinates=files.gro, rigid="none")
    assert again.species == ours.species
    assert not again.box.periodic
    assert np.abs(again.state.positions - ours.state.positions).max() < 1e-12
    parts = read(files.top, Asked(files.gro, (), rigid="none"))
    energies, expected = (energies_of(context_of(each, x), each) for each in (parts.system, theirs))
    assert energies == pytest.approx(expected, rel=1e-12)
    with pytest.raises(kd.InputError, match="exists already"):
        ours.to_gromacs(tmp_path / "alanine.top")
    with pytest.raises(kd.InputError, match=r"to_gromacs: force 'cmap' has no counterpart"):
        kd.System.from_openmm(built(topology, "amber19-all.xml"), topology, x).to_gromacs(tmp_path / "b.top")
    with pytest.raises(kd.InputError, match=r"expected a name that ends in .top or .gro"):
        ours.to_gromacs(tmp_path / "alanine")


@pytest.mark.parametrize("file", ["tip3p.xml", "tip4pew.xml"])
def test_rigid_water_goes_to_gromacs_and_back(file, water, tmp_path):
    """Equal molecules are written once, with constraints, charges and virtual sites."""
    made = app.Modeller(water[0], water[1] * unit.nanometer)
    made.addExtraParticles(app.ForceField(file))
    x = np.array(made.positions.value_in_unit(unit.nanometer))
    theirs = built(made.topology, file, rigidWater=True, nonbondedMethod=app.PME, nonbondedCutoff=0.6)
    ours = kd.System.from_openmm(theirs, made.topology, x)
    files = ours.to_gromacs(tmp_path / "water.top")
    assert "[ molecules ]\nM1 64\n" in files.top.read_text()
    again = read(files.top, Asked(files.gro, (), 0.6, "none")).system
    assert again.getNumConstraints() == theirs.getNumConstraints()
    energies, expected = (energies_of(context_of(each, ours.state.positions), each) for each in (again, theirs))
    assert energies["NonbondedForce"] == pytest.approx(expected["NonbondedForce"], rel=1e-9)


@pytest.mark.long
def test_rigid_water_by_mesh_is_that_of_openmm(water):
    """OpenMM averages the energy beyond the cutoff over N (N + 1) / 2 pairs, kickdrift over N^2 / 2."""
    topology, x = water
    theirs = built(
        topology, "tip3p.xml", nonbondedMethod=app.PME, nonbondedCutoff=0.6, rigidWater=True, ewaldErrorTolerance=1e-8
    )
    (pairs,) = [force for force in theirs.getForces() if isinstance(force, openmm.NonbondedForce)]
    pairs.setUseDispersionCorrection(False)
    ours = kd.System.from_openmm(theirs, topology, x)
    assert ours.species == ("O", "H")
    assert len(ours.constraints) == 192
    assert np.abs(ours.state.positions - x).max() < 1e-4
    assert_alike(theirs, ours, 1e-6, 1e-5)


@pytest.mark.long
def test_water_in_a_reaction_field_takes_the_steps_of_openmm(water):
    topology, x = water
    theirs = built(topology, "tip3p.xml", nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=0.6, rigidWater=False)
    ours = kd.System.from_openmm(theirs, topology, x * unit.nanometer)
    law = next(force for force in ours.forces if force.name == "lennard-jones")
    assert law.tail_corrections(ours)[0] < 0
    (pairs,) = [force for force in theirs.getForces() if isinstance(force, openmm.NonbondedForce)]
    pairs.setUseDispersionCorrection(False)
    without = kd.System.from_openmm(theirs, topology, x)
    assert_alike(theirs, without, 1e-8, 1e-8)
    assert_same_steps(theirs, without)


@pytest.mark.long
def test_a_switching_function_is_that_of_openmm(water):
    """Energies and forces, with the dispersion correction, whose pairs OpenMM counts with each particle itself."""
    topology, x = water
    theirs = built(
        topology, "tip3p.xml", nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=0.6, switchDistance=0.45,
        rigidWater=False,
    )  # fmt: skip
    ours = kd.System.from_openmm(theirs, topology, x)
    (pairs,) = [force for force in theirs.getForces() if isinstance(force, openmm.NonbondedForce)]
    whole = energies_of(context_of(theirs, x), theirs)["NonbondedForce"]
    pairs.setUseDispersionCorrection(False)
    without = kd.System.from_openmm(theirs, topology, x)
    assert without.forces[0].switch_start == pytest.approx(0.45)
    assert_alike(theirs, without, 1e-8, 1e-8)
    tail = whole - energies_of(context_of(theirs, x), theirs)["NonbondedForce"]
    alike = (1 + 1 / 64) / (1 + 1 / 192)  # pairs of 64 oxygens over all pairs, each with itself
    assert ours.forces[0].tail_corrections(ours)[0] * alike == pytest.approx(tail, rel=1e-9)
    again = kd.System.from_openmm(*ours.to_openmm())
    assert again.forces[0] == ours.forces[0]


@pytest.mark.parametrize("file", ["tip4pew.xml", "tip5p.xml"])
def test_virtual_sites_are_those_of_openmm(water, file):
    topology, x = with_sites(*water, file)
    theirs = built(topology, file, nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=0.6, rigidWater=True)
    ours = kd.System.from_openmm(theirs, topology, x)
    assert len(ours.virtual_sites) == len(ours) - 192
    context = context_of(theirs, ours.state.positions)
    context.computeVirtualSites()
    there = context.getState(positions=True).getPositions(asNumpy=True).value_in_unit(unit.nanometer)
    assert np.abs(there - ours.state.positions).max() < 1e-12


def four(formula, rest):
    """OpenMM's System of four particles with one CustomTorsionForce, and their places."""
    made, force = openmm.System(), openmm.CustomTorsionForce(formula)
    for key in ("k", "theta0"):
        force.addPerTorsionParameter(key)
    for _ in range(4):
        made.addParticle(12.0)
    force.addTorsion(0, 1, 2, 3, [150.0, rest])
    made.addForce(force)
    return made, np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.15, 0.1, 0.0], [0.2, 0.1, 0.03]])


FORMULAS = (  # of OpenMM's readers of psf and of top
    "k*min(dtheta, 2*pi-dtheta)^2; dtheta = abs(theta-theta0);pi = 3.141593;",
    "0.5*k*(thetap-theta0)^2; thetap = step(-(theta-theta0+pi))*2*pi+theta+step(theta-theta0-pi)*(-2*pi); "
    "pi = 3.14159265358979",
)


@pytest.mark.parametrize("rest", [0.0, np.pi])
@pytest.mark.parametrize("formula", FORMULAS)
def test_harmonic_impropers_are_those_of_openmm(formula, rest):
    theirs, x = four(formula, rest)
    ours = kd.System.from_openmm(theirs, None, x)
    (expected,) = energies_of(context_of(theirs, x), theirs).values()
    assert BoundForces(ours).measure(0.0, ours.state.phase).potential == pytest.approx(expected, rel=1e-6)


def test_other_torsions_are_formulas():
    for formula, at in ((FORMULAS[1], 0.5), ("k*(theta-theta0)^4", 0.0)):
        theirs, x = four(formula, at)
        ours = kd.System.from_openmm(theirs, None, x)
        (force,) = ours.forces
        assert force.name == "formula-improper"
        _, (law,), _ = force.items(ours)
        angle = measured(ours.box, ours.state.phase[0], ours.topology.impropers, "impropers")[0]
        (expected,) = energies_of(context_of(theirs, x), theirs).values()
        assert law.law(angle)[0] == pytest.approx(expected, rel=1e-9)


def test_barostats_and_integrators_become_defaults(water):
    topology, x = water
    theirs = built(topology, "tip3p.xml", nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=0.6)
    theirs.addForce(openmm.MonteCarloBarostat(1.0, 300.0, 25))
    ours = kd.System.from_openmm(theirs, topology, x, integrator=openmm.LangevinMiddleIntegrator(310.0, 2.0, 0.002))
    assert (ours.run.integrator, ours.run.dt) == ("baoa", 0.002)
    assert ours.run.options["temperature"] == 310.0
    assert ours.run.options["friction"] == 2.0
    assert ours.run.options["pressure"] == pytest.approx(0.0602214, rel=1e-6)  # 1 bar in kJ/mol/nm^3
    assert kd.System.from_openmm(theirs, topology, x).run.options["temperature"] == 300.0


def test_an_imported_barostat_runs(water):
    """OpenMM's barostat has no compressibility; a frequency of 0 turns it off."""
    topology, x = water
    theirs = built(topology, "tip3p.xml", nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=0.6)
    pressed = openmm.MonteCarloBarostat(1.0, 300.0, 5)
    theirs.addForce(pressed)
    integrator = openmm.LangevinMiddleIntegrator(300.0, 2.0, 0.001)
    ours = kd.System.from_openmm(theirs, topology, x, integrator=integrator)
    assert ours.run.options["compressibility"] == pytest.approx(7.4724e-4, rel=1e-4)  # of water, in nm^3 mol/kJ
    run = kd.Simulation(ours, seed=1)
    run.run(steps=20)
    assert run.state.box.lengths != ours.box.lengths
    pressed.setFrequency(0)
    assert not {"barostat", "pressure"} & set(kd.System.from_openmm(theirs, topology, x).run.options)


@pytest.mark.parametrize("which", ["alanine", "water"])
def test_a_system_goes_to_openmm_and_comes_back(which, request):
    topology, x = request.getfixturevalue(which)
    more = {"nonbondedMethod": app.CutoffPeriodic, "nonbondedCutoff": 0.6, "rigidWater": False}
    first = kd.System.from_openmm(
        built(topology, "amber14-all.xml") if which == "alanine" else built(topology, "tip3p.xml", **more), topology, x
    )
    again = kd.System.from_openmm(*first.to_openmm())
    assert again.species == first.species
    kept, back = (system.topology.tables() for system in (first, again))
    assert sorted(map(sorted, back.pop("exclusions"))) == sorted(map(sorted, kept.pop("exclusions")))
    assert back == kept
    assert [force.name for force in again.forces] == [force.name for force in first.forces]
    energies = [BoundForces(system).measure(0.0, system.state.phase).potential for system in (first, again)]
    assert energies[1] == pytest.approx(energies[0], rel=1e-13)


def across(coulomb, factors):
    """A molecule of two particles across the edge of a box, and one of three."""
    x = np.array([[0.02, 0.5, 0.5], [1.95, 0.5, 0.5], [0.3, 1.0, 1.0], [0.4, 1.2, 1.0], [0.5, 1.1, 1.1]])
    return kd.System(
        x, masses=5 * [12.0], box=[2.0, 2.0, 2.0], units="gromacs", charges=[0.1, -0.1, 0.1, -0.2, 0.1],
        topology=kd.Topology(bonds=[(0, 1), (2, 3), (3, 4)], factors=factors),
        forces=[kd.LennardJones(1.0, 0.2, cutoff=0.9, truncation="cut"), coulomb, kd.HarmonicBond(1000.0, 0.1)],
    )  # fmt: skip


@pytest.mark.long
def test_molecules_across_the_edge_of_a_box_have_the_energy_of_openmm():
    ours = across(kd.Coulomb("ewald", cutoff=0.9, accuracy=1e-8), (0.5, 0.0, 0.0))
    theirs, _, x, _ = ours.to_openmm()
    energy = sum(energies_of(context_of(theirs, x), theirs).values())
    assert BoundForces(ours).measure(0.0, ours.state.phase).potential == pytest.approx(energy, rel=1e-7)


def test_what_openmm_lacks_is_named(alanine):
    topology, x = alanine
    ours = kd.System.from_openmm(built(topology, "amber14-all.xml"), topology, x)
    for system, match in (
        (kd.load("lj-1000"), "to_openmm: units 'lj'"),
        (ours.with_fixed(kd.Fixed(0, velocity=[0.1, 0, 0])), "to_openmm: OpenMM keeps fixed particles at rest"),
        (ours.with_forces(*ours.forces, kd.HarmonicTrap(1.0)), "to_openmm: force 'harmonic-trap' has no counterpart"),
        (ours.with_forces(kd.LennardJones(cutoff=1.0, truncation="force-shift")), "has no truncation 'force-shift'"),
        (ours.with_forces(kd.LennardJones(cutoff=1.0, truncation="cut"), kd.Coulomb("direct")), "one cutoff for both"),
        (
            across(kd.Coulomb("reaction-field", cutoff=0.9), (0.0, 0.5, 1.0)),
            r"coulomb: pair \[2, 4\] is scaled in a react",
        ),
        (
            ours.with_forces(*ours.forces, kd.ListedPairs([(0, 21)], 1.0)),
            r"pair \[0, 21\] is not left out of the other pair forces",
        ),
    ):
        with pytest.raises(kd.InputError, match=match):
            system.to_openmm()


def refused(theirs, topology, x, match, **more):
    with pytest.raises(kd.InputError, match=match):
        kd.System.from_openmm(theirs, topology, x, **more)


def test_what_has_no_counterpart_is_named(alanine):
    topology, x = alanine
    theirs = built(topology, "amber14-all.xml")
    refused(theirs, topology, x[:-1], r"positions: expected shape \(22, 3\), one row for each particle")
    refused(theirs, app.Topology(), x, r"topology: has 0 atoms, and the system 22 particles")
    refused(None, topology, x, r"system: expected openmm.System, got NoneType")
    refused(
        theirs,
        topology,
        x,
        "integrator: BrownianIntegrator has no counterpart",
        integrator=openmm.BrownianIntegrator(1, 1, 1),
    )
    solvent = openmm.GBSAOBCForce()
    for _ in range(22):
        solvent.addParticle(0.0, 0.1, 0.8)
    theirs.addForce(solvent)
    refused(theirs, topology, x, "GBSAOBCForce, has no counterpart")


def test_particles_without_a_counterpart_are_named():
    topology, chain = app.Topology(), None
    chain = topology.addChain()
    theirs = openmm.System()
    for k in range(3):
        topology.addAtom("X", None, topology.addResidue("X", chain))
        theirs.addParticle(0.0 if k == 2 else 1.0)
    x = np.eye(3)
    assert kd.System.from_openmm(theirs, topology, x).fixed.particles.tolist() == [2]
    axes = openmm.Vec3(1, 0, 0), openmm.Vec3(-1, 1, 0), openmm.Vec3(0, -1, 1)
    theirs.setVirtualSite(2, openmm.LocalCoordinatesSite(0, 1, 1, *axes, openmm.Vec3(0.1, 0, 0)))
    refused(theirs, topology, x, "particle 2 is a LocalCoordinatesSite, which has no counterpart")


# --- files ---

TOP = """\
[ defaults ]
1 2 yes 0.5 0.5

[ atomtypes ]
C 6 12.011 0.0 A 0.35 0.3
O 8 15.999 0.0 A 0.30 0.7

[ moleculetype ]
acid 3

[ atoms ]
1 C 1 ACI C1 1 0.1 12.011
2 C 1 ACI C2 1 0.2 12.011
3 C 1 ACI C3 1 0.1 12.011
4 O 1 ACI O 1 -0.4 15.999

[ bonds ]
1 2 1 0.15 2e5
2 3 1 0.15 2e5
3 4 1 0.14 3e5

[ pairs ]
1 4 1

[ angles ]
1 2 3 1 110.0 400.0
2 3 4 1 112.0 450.0

[ dihedrals ]
1 2 3 4 3 1.0 2.0 -0.5 0.3 0.2 0.1

[ system ]
acid

[ molecules ]
acid 1
"""
GRO = """\
acid
    4
    1ACI     C1    1   0.100   0.100   0.100
    1ACI     C2    2   0.250   0.105   0.100
    1ACI     C3    3   0.310   0.240   0.110
    1ACI      O    4   0.430   0.250   0.190
   2.50000   2.50000   2.50000
"""


@pytest.fixture
def files(tmp_path):
    for name, text in (("acid.top", TOP), ("acid.gro", GRO), ("alanine.pdb", ALANINE)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_a_top_and_a_gro_are_one_system(files):
    ours = kd.load(files / "acid.top", coordinates=files / "acid.gro", cutoff="9 angstrom", rigid="none")
    assert [force.name for force in ours.forces] == [
        "lennard-jones", "coulomb", "listed-pairs", "harmonic-bond", "harmonic-angle", "ryckaert-bellemans",
    ]  # fmt: skip
    assert ours.forces[1].cutoff == pytest.approx(0.9)
    assert ours.forces[2].pairs == ((0, 3),)
    assert ours.forces[2].epsilon == pytest.approx((0.5 * np.sqrt(0.3 * 0.7),))
    assert ours.forces[2].charges == pytest.approx((-0.02,))
    assert ours.box.lengths == (2.5, 2.5, 2.5)
    assert ours.name == "acid"


def test_a_structure_with_a_force_field_is_a_system(files):
    with pytest.warns(UserWarning, match="seed: this system draws nothing at random"):
        ours = kd.load(files / "alanine.pdb", seed=1, force_field="amber14-all.xml")
    assert len(ours.constraints) == 12
    assert ours.units.name == "gromacs"
    assert kd.load(files / "alanine.pdb").units.name == "metal"  # bare atoms, through ASE


def test_bad_files_end_in_one_line(files):
    top, pdb = files / "acid.top", files / "alanine.pdb"
    (files / "broken.top").write_text(TOP.replace("C 6 12.011 0.0 A 0.35 0.3\n", ""), encoding="utf-8")
    (files / "own.xml").write_text("<ForceField><Script>print(1)</Script></ForceField>", encoding="utf-8")
    (files / "x.prmtop").write_text("%VERSION\n", encoding="utf-8")
    (files / "cut.gro").write_text(GRO[:100], encoding="utf-8")
    (files / "few.top").write_text(TOP[:200], encoding="utf-8")
    for match, path, more in (
        (
            r"acid.top: give --coordinates FILE \(coordinates in Python and in \[particles\]\); it is a topology",
            top,
            {},
        ),
        (
            r"force_field: .*x.prmtop holds its force field; only \.top, \.psf",
            files / "x.prmtop",
            {"coordinates": pdb, "force_field": "amber14-all.xml"},
        ),
        (r"coordinates: .*alanine.pdb has its own", pdb, {"coordinates": pdb, "force_field": "amber14-all.xml"}),
        ("coordinates: is for files of force fields", "lj-1000", {"coordinates": pdb}),
        ("cutoff: is for files of force fields.*, and a dict is none of these", {"units": "lj"}, {"cutoff": 1.0}),
        ("none.gro: no such file", top, {"coordinates": files / "none.gro"}),
        (r"coordinates come from files that end in \.inpcrd", top, {"coordinates": top}),
        ("cut.gro: line 4: is no whole atom, and line 2 says 4 atoms", top, {"coordinates": files / "cut.gro"}),
        ("broken.top: OpenMM cannot take it", files / "broken.top", {"coordinates": files / "acid.gro"}),
        (
            "few.top: is no whole .top file: it has no .* molecules",
            files / "few.top",
            {"coordinates": files / "acid.gro"},
        ),
        ("No template found for residue 0", pdb, {"force_field": "tip3p.xml"}),
        ("own.xml: has a script, which OpenMM would run as Python", pdb, {"force_field": str(files / "own.xml")}),
        ("rigid: expected hydrogen, water, none, got 'all'", pdb, {"force_field": "amber14-all.xml", "rigid": "all"}),
        ("cutoff: expected a length above zero, got -1", pdb, {"force_field": "amber14-all.xml", "cutoff": -1}),
        ("cutoff: is for files of force fields", pdb, {"cutoff": 1.0}),
        ("snapshot: is for archives of rebound", pdb, {"force_field": "amber14-all.xml", "snapshot": 0}),
    ):
        with pytest.raises(kd.InputError, match=match) as caught:
            kd.load(path, **more)
        assert "\n" not in str(caught.value)


EVIL = """\
<ForceField><NonbondedForce coulomb14scale="1" lj14scale="1" useDispersionCorrection="open('ran', 'w')"/></ForceField>
"""


@pytest.mark.parametrize("kind", ["NonbondedForce", "LennardJonesForce"])
@pytest.mark.parametrize("place", ["given", "here", "further", "shipped"])
def test_no_force_field_runs_code(files, monkeypatch, kind, place):
    """OpenMM's reader evaluates an attribute, also in files that another includes from the working folder."""
    work, shipped = files / "work", files / "shipped"
    work.mkdir()
    shipped.mkdir()
    monkeypatch.chdir(work)
    monkeypatch.setattr(app.forcefield, "_dataDirectories", [str(shipped)])
    (work / "evil.xml").write_text(EVIL.replace("NonbondedForce", kind), encoding="utf-8")
    for name, inner in (("here.xml", "evil.xml"), ("further.xml", "here.xml"), ("shipped/own.xml", "evil.xml")):
        (files / name).write_text(f'<ForceField><Include file="{inner}"/></ForceField>', encoding="utf-8")
    given = {"given": "evil.xml", "here": str(files / "here.xml"), "further": "../further.xml", "shipped": "own.xml"}
    with pytest.raises(kd.InputError, match=r"evil.xml: useDispersionCorrection: expected True, False, 0 or 1, got"):
        kd.load(files / "alanine.pdb", force_field=given[place])
    assert not (work / "ran").exists()


def test_an_include_found_nowhere_is_refused(files):
    (files / "own.xml").write_text('<ForceField><Include file="none.xml"/></ForceField>', encoding="utf-8")
    with pytest.raises(kd.InputError, match=r"'none\.xml': no such file, and OpenMM ships none of this name"):
        kd.load(files / "alanine.pdb", force_field=str(files / "own.xml"))


def test_own_force_fields_include_others(files, monkeypatch):
    """Files of the folder and of OpenMM, each once, and a value that OpenMM evaluates."""
    monkeypatch.chdir(files)
    (files / "own.xml").write_text('<ForceField><Include file="a.xml"/><Include file="own.xml"/></ForceField>')
    (files / "a.xml").write_text('<ForceField><Include file="amber14-all.xml"/></ForceField>')
    ours = kd.load("alanine.pdb", force_field=("own.xml", "a.xml"))
    assert len(ours.constraints) == 12
    (files / "a.xml").write_text(EVIL.replace("open('ran', 'w')", "False"))
    with pytest.raises(kd.InputError, match="No template found"):  # read to its end
        kd.load("alanine.pdb", force_field="own.xml")


def test_a_structure_without_a_force_field_runs_with_a_warning(files, kickdrift):
    status, _, err = kickdrift("run", files / "alanine.pdb", "--dt", "1 fs", "--steps", "2")
    assert status == 0
    assert err.count("no force acts; give force_field (--force-field)") == 1


def test_a_system_file_has_a_force_field(files, kickdrift):
    top = """
    units = "real"
    force_field = { cutoff = "9 angstrom", rigid = "none" }
    particles = { file = "acid.top", coordinates = "acid.gro" }
    """
    pdb = top.replace("acid.top", "alanine.pdb").replace(', coordinates = "acid.gro"', "")
    pdb = pdb.replace('cutoff = "9 angstrom"', 'files = ["amber14-all.xml"]')
    for name, text, plain in (
        ("a.toml", top, kd.load(files / "acid.top", coordinates=files / "acid.gro", cutoff=0.9, rigid="none")),
        ("b.toml", pdb, kd.load(files / "alanine.pdb", force_field="amber14-all.xml", rigid="none")),
    ):
        (files / name).write_text(text, encoding="utf-8")
        ours = kd.load(files / name)
        assert ours.units.name == "real"
        assert [force.name for force in ours.forces] == [force.name for force in plain.forces]
        found = [BoundForces(each).measure(0.0, each.state.phase).potential for each in (ours, plain)]
        assert found[0] * 4.184 == pytest.approx(found[1], rel=1e-12)
    for old, new, problem in (
        ('"real"', '"lj"', "force_field.cutoff: lj quantities are plain numbers"),
        ('"real"', '"si"', "units: a force field has units metal, real, gromacs, got 'si'"),
        (', coordinates = "acid.gro"', "", "particles.file: .*acid.top: give --coordinates FILE"),
        ('file = "acid.top", coordinates = "acid.gro"', "positions = [[0, 0, 0]]", "force_field: goes with particles"),
        ('"none"', '"all"', "force_field.rigid: expected 'hydrogen', 'water' or 'none'"),
    ):
        with pytest.raises(kd.InputError, match=problem):
            loads(top.replace(old, new), folder=files)
    status, _, err = kickdrift("info", files / "acid.top", "--coordinates", files / "acid.gro")
    assert (status, err) == (0, "")


@pytest.mark.long
def test_other_units_and_sites_go_to_openmm(water):
    topology, x = with_sites(*water, "tip4pew.xml")
    theirs = built(topology, "tip4pew.xml", nonbondedMethod=app.CutoffPeriodic, nonbondedCutoff=0.6, rigidWater=True)
    first = kd.System.from_openmm(theirs, topology, x)
    again = kd.System.from_openmm(*first.in_units("metal").to_openmm())
    assert again.state.phase == pytest.approx(first.state.phase, abs=1e-12)
    found = [BoundForces(each).measure(0.0, each.state.phase).potential for each in (again, first)]
    assert found[0] == pytest.approx(found[1], rel=1e-11)


def test_scaled_pairs_beyond_a_cutoff_are_refused():
    x = np.array([[0.1, 0.1, 0.1], [0.5, 0.1, 0.1], [0.9, 0.1, 0.1]])
    ours = kd.System(
        x, masses=12.0, box=[3.0] * 3, units="gromacs",
        forces=[kd.LennardJones(1.0, 0.3, cutoff=0.7, truncation="cut")],
        topology=kd.Topology([(0, 1), (1, 2)], factors=(0.0, 0.5, 1.0)),
    )  # fmt: skip
    with pytest.raises(kd.InputError, match=r"scaled pair \[0, 2\] is 0.8 nm apart, beyond 0.7 nm, and OpenMM has no"):
        ours.to_openmm()
