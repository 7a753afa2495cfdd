"""Pair laws that ship, beside LAMMPS' styles: forces, and differences of energies, of two particles."""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.engines.lammps_world import lammps_class
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.pairs.law import PairForce
from kickdrift.systemfile.reading import loads
from kickdrift_validation.docs_tables import LAWS, LAWS_END, pair_laws_table
from tests.folders import DOCS

SILICON, COPPER = 14, 29
COULOMB = 14.399645  # e^2 / (4 pi epsilon_0) in eV angstrom, as LAMMPS has it
ZBL = COULOMB * SILICON * COPPER, 0.46850 / (SILICON**0.23 + COPPER**0.23)
X = [[0.0, 0.0, 0.0], [1.2, 0.0, 0.0], [0.0, 1.2, 1.0]]
STYLES = {  # the law's parameters, LAMMPS' style and its coefficients
    "buckingham": ((300.0, 0.25, 1.2), "buck 2.0", "300.0 0.25 1.2"),
    "born-mayer-huggins": ((1.0, 0.25, 1.1, 1.2, 0.3), "born 2.0", "1.0 0.25 1.1 1.2 0.3"),
    "morse-pair": ((1.0, 5.0, 1.1), "morse 2.0", "1.0 5.0 1.1"),
    "yukawa": ((2.0, 1.3), "yukawa 1.3 2.0", "2.0"),
    "mie": ((0.5, 0.88, 11.3, 7.1), "mie/cut 2.0", "0.5 0.88 11.3 7.1"),
    "soft-pair": ((2.0, 1.8), "soft 1.8", "2.0"),
    "weeks-chandler-andersen": ((1.5, 1.2), f"lj/cut {2 ** (1 / 6) * 1.2!r}", "1.5 1.2"),
    "gaussian-core": ((2.0, 0.9), "gauss 2.0", f"-2.0 {1 / 0.9**2!r}"),
    "zbl": (ZBL, "zbl 1.9 2.0", f"{SILICON} {COPPER}"),
}
DISTANCES = np.linspace(0.7, 1.88, 15)


def of_lammps(style: str, coefficients: str) -> np.ndarray:
    """Energy and force (distances, 2) of two particles in LAMMPS."""
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    try:
        for line in (
            f"units {'metal' if style.startswith('zbl') else 'lj'}", "atom_modify map array", "boundary f f f",
            "region all block -9 9 -9 9 -9 9", "create_box 2 all", "mass * 1.0", f"pair_style {style}",
            "pair_coeff 1 1 " + (f"{SILICON} {SILICON}" if style.startswith("zbl") else coefficients),
            *([f"pair_coeff 2 2 {COPPER} {COPPER}"] if style.startswith("zbl") else [f"pair_coeff 2 2 {coefficients}"]),
            f"pair_coeff 1 2 {coefficients}", "pair_modify shift yes", "thermo_modify norm no",
        ):  # fmt: skip
            lmp.command(line)
        lmp.create_atoms(2, [1, 2], [1, 2], [0.0] * 5 + [1.0])
        found = []
        for r in DISTANCES.tolist():
            lmp.command(f"set atom 2 z {r!r}")
            lmp.command("run 0 post no")
            found.append((lmp.get_thermo("pe"), lmp.gather_atoms("f", 1, 3)[5]))
    finally:
        lmp.close()
    return np.array(found)


@pytest.mark.parametrize("name", STYLES)
def test_a_law_is_that_of_lammps(name):
    given, style, coefficients = STYLES[name]
    law = FORCES[name](*given, cutoff=2.5).law
    expected = of_lammps(style, coefficients)
    energy, over_r = np.array([law.law(r * r) for r in DISTANCES.tolist()], dtype=float).T
    size = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(over_r * DISTANCES, expected[:, 1], rtol=1e-14, atol=1e-14 * size[1])
    apart = (energy - energy[0]) - (expected[:, 0] - expected[0, 0])  # zbl adds a constant
    assert np.abs(apart).max() < 2e-14 * size[0]


def test_mie_with_12_and_6_is_lennard_jones():
    mie, lj = kd.Mie(0.7, 0.9).law, kd.LennardJones(0.7, 0.9).law
    np.testing.assert_allclose(mie.law(1.21), lj.law(1.21), rtol=1e-14)


def test_the_default_cutoff_is_the_reach_of_the_law():
    assert kd.WeeksChandlerAndersen(sigma=1.2).cutoff == pytest.approx(1.2 * 2 ** (1 / 6))
    assert kd.SoftPair(sigma=1.8).cutoff == 1.8
    assert kd.Mie(sigma=1.8).cutoff == 4.5
    with pytest.raises(InputError, match="born-mayer-huggins: cutoff is needed"):
        kd.BornMayerHuggins()


def test_powers_of_species_mix_if_they_are_the_same():
    same = kd.Mie(n=14.0, m=7.0, species={"A": {"sigma": 1.0}, "B": {"sigma": 2.0, "epsilon": 4.0}})
    assert same.pair_law("A", "B") == (2.0, 1.5, 14.0, 7.0)
    other = kd.Mie(species={"A": {"n": 12.0}, "B": {"n": 14.0}})
    with pytest.raises(InputError, match="pair A-B is needed: only epsilon and sigma can be mixed"):
        other.pair_law("A", "B")


def test_a_system_file_names_a_law_with_units():
    text = """
    units = "metal"
    [particles]
    positions = [[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]
    mass = "16 u"
    [velocities]
    values = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    [[force]]
    type = "buckingham"
    A = "9547.96 eV"
    rho = "0.21916 angstrom"
    C = "32.0 eV angstrom^6"
    cutoff = "1 nm"
    """
    (force,) = loads(text).forces
    assert force == kd.Buckingham(9547.96, 0.21916, 32.0, cutoff=10.0)
    assert math.isclose(force.law.law(4.0)[0], 9547.96 * math.exp(-2.0 / 0.21916) - 0.5)


def test_a_name_that_no_particle_has_is_refused_with_the_nearest():
    named = {
        "'Kr', 'ar'; did you mean 'Ar'": {"species": {"Ar": {}, "Kr": {}}, "pairs": {("Ar", "ar"): {"epsilon": 2.0}}},
        "'Arr'; did you mean 'Ar'": {"pairs": {("Ar", "Arr"): {"epsilon": 2.0}}},
    }
    for told, tables in named.items():
        with pytest.raises(InputError, match=rf"^lennard-jones: no particle is of species {told.split(';')[0]}"):
            kd.System(X, forces=[kd.LennardJones(cutoff=2.0, **tables)], species=["Ar"] * 3)
    file = """
units = "lj"
particles = { positions = [[0, 0, 0], [1.2, 0, 0]], species = ["Ar", "Kr"] }
[[force]]
type = "yukawa"
cutoff = 2.0
[[force.pairs]]
species = ["Ar", "Krr"]
"""
    with pytest.raises(InputError, match=r"^system: yukawa: no particle is of species 'Krr'; did you mean 'Kr'\?"):
        loads(file)
    copper = kd.load("copper-864")
    with pytest.raises(InputError, match=r"^eam: elements: no particle is of species 'Cuu'; did you mean 'Cu'\?"):
        copper.with_forces([kd.EmbeddedAtom(copper.forces[0].file, elements={"Cuu": "Cu"})])


def test_a_file_with_a_name_that_no_particle_has_goes_on(tmp_path, monkeypatch):
    """Version 0.2.0 ran with such names, and warned."""
    force = kd.LennardJones(cutoff=2.0, pairs={("A", "A"): {"epsilon": 2.0}, ("A", "B"): {"epsilon": 3.0}})
    with monkeypatch.context() as before:
        before.setattr(PairForce, "names", ())
        kd.Simulation(kd.System(X, forces=[force]), dt=0.001).run(4, output=tmp_path / "old.h5md")
    sim = kd.resume(tmp_path / "old.h5md")
    assert sim.system.forces[0].pairs == {("A", "A"): {"epsilon": 2.0}}
    assert sim.run(4).steps == 8


def test_the_cutoff_follows_from_those_of_all_pairs():
    pairs = {("A", "A"): {"A": 9.0, "cutoff": 2.5}, ("A", "B"): {"cutoff": 2.0}, ("B", "B"): {"cutoff": 1.5}}
    force = kd.Buckingham(pairs=pairs)
    assert force.cutoff == 2.5
    assert [force.pair_end(*pair).cutoff for pair in pairs] == [2.5, 2.0, 1.5]
    assert kd.Mie(pairs={("A", "A"): {"sigma": 0.3, "cutoff": 0.9}}).cutoff == 0.9
    with pytest.raises(InputError, match=r"^buckingham: cutoff of pair A-B is needed$"):
        kd.Buckingham(pairs={**pairs, ("A", "B"): {"A": 2.0}})
    with pytest.raises(InputError, match=r"^buckingham: cutoff of species B is needed$"):
        kd.Buckingham(species={"A": {"cutoff": 2.0}, "B": {}})


@pytest.mark.parametrize(("n", "m"), [(6.0, 6.0), (12.0, 0.0), (-3.0, 6.0)])
def test_powers_of_mie(n, m):
    with pytest.raises(InputError, match=rf"^mie: n and m must be two different positive powers, got n = {n:g} and m"):
        kd.Mie(n=n, m=m)


def test_a_users_law_has_the_name_of_a_shipped_one():
    """Users had laws of these names before kickdrift did."""
    shipped = FORCES["yukawa"]
    made = namedtuple("Yukawa", ["strength"], defaults=[1.0])
    made.__module__, made.law = "mine", lambda p, r2: (p.strength / r2, 2.0 * p.strength / r2**2)
    try:
        own = kd.pair_law(made)
        file = 'units = "lj"\nparticles = { positions = [[0, 0, 0], [1.2, 0, 0]] }\n'
        system = loads(f'{file}[[force]]\ntype = "yukawa"\nstrength = 2.0\ncutoff = 3.0\n')
        assert type(system.forces[0]) is own
        assert "yukawa" in system.to_toml()
        with pytest.raises(InputError, match=r"to_toml: a system file cannot name the force kickdrift\.forces"):
            system.with_forces([kd.Yukawa(cutoff=3.0)]).to_toml()
    finally:
        FORCES["yukawa"] = shipped


def test_the_page_has_the_table_of_laws():
    """If this fails, run: python -m kickdrift_validation.docs_tables"""
    page = (DOCS / "system-file.md").read_text(encoding="utf-8")
    assert page.split(LAWS)[1].split(LAWS_END)[0].strip() == pair_laws_table()
