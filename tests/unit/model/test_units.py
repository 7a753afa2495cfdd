"""Unit systems and quantities against constants written out here, and against each other."""

import subprocess
import sys

import pytest
import scipy.constants
from hypothesis import given, settings
from hypothesis import strategies as st

from kickdrift.errors import InputError
from kickdrift.model.units import constants
from kickdrift.model.units.quantities import number_density, quantity
from kickdrift.model.units.unit_systems import DIMENSIONS, UNIT_SYSTEMS, unit_system
from kickdrift.text import suggestion

METAL, LJ = UNIT_SYSTEMS["metal"], UNIT_SYSTEMS["lj"]
WITH_UNITS = [units for units in UNIT_SYSTEMS.values() if not units.reduced]


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("3.4 angstrom", "length", 3.4),
        ("0.34 nm", "length", 3.4),
        ("3.4e-10m", "length", 3.4),
        ("94.4 K", "temperature", 94.4),
        ("25 degC", "temperature", 298.15),
        ("10 fs", "time", 0.01),
        ("39.948 u", "mass", 39.948),
        ("39.948 g/mol", "mass", 39.948 / 1.0000000010531),  # N_A u is no longer exactly 1 g/mol
        ("120 K", "energy", 120 * 8.617333262145e-5),
        ("1 kJ/mol", "energy", 1000 / 6.02214076e23 / 1.602176634e-19),
        ("0.24 kcal/mol", "energy", 240 * 4.184 / 6.02214076e23 / 1.602176634e-19),
        ("300 m/s", "velocity", 3.0),
        ("300 m s-1", "velocity", 3.0),
        ("1.374 g/cm3", "density", 1.374e-24 / 1.66053906892e-24),
        ("1.374 g cm^-3", "density", 1.374e-24 / 1.66053906892e-24),
        ("21 nm**-3", "number_density", 0.021),
        ("35 mol/L", "number density", 35 * 6.02214076e23 / 1e27),
        ("1 bar", "pressure", 1e5 * 1e-30 / 1.602176634e-19),
    ],
)
def test_text_becomes_a_number_in_metal_units(text, dimension, expected):
    assert quantity(text, dimension, METAL) == pytest.approx(expected, rel=1e-10)


def test_written_numbers_survive_exactly():
    assert quantity("34.78 angstrom", "length", METAL) == 34.78
    assert quantity("39.948 u", "mass", METAL) == 39.948
    assert quantity("94.4 K", "temperature", METAL) == 94.4


@pytest.mark.parametrize("units", WITH_UNITS, ids=lambda units: units.name)
@pytest.mark.parametrize("dimension", [dimension for dimension, powers in DIMENSIONS.items() if powers])
def test_one_of_its_own_unit_is_one(units, dimension):
    assert quantity(f"1 {units.unit(dimension)}", dimension, units) == pytest.approx(1, rel=1e-14)


@given(st.floats(1e-30, 1e30), st.sampled_from(["length", "time", "mass", "temperature", "velocity"]))
def test_two_unit_systems_agree_on_a_quantity(number, dimension):
    metal = quantity(f"{number!r} {METAL.unit(dimension)}", dimension, METAL)
    si = quantity(f"{number!r} {METAL.unit(dimension)}", dimension, UNIT_SYSTEMS["si"])
    assert metal == pytest.approx(number, rel=1e-14)
    assert quantity(f"{si!r} {UNIT_SYSTEMS['si'].unit(dimension)}", dimension, METAL) == pytest.approx(
        number, rel=1e-12
    )


def test_gravity_of_astro_is_the_suns_gm_and_keplers_third_law():
    astro = UNIT_SYSTEMS["astro"]
    gaussian = 0.01720209895**2 * 365.25**2  # the same GM in the astronomical unit of 1976
    assert astro.gravity == pytest.approx(gaussian, rel=1e-11)
    assert astro.gravity == pytest.approx(1.32712440040944e20 * 31557600.0**2 / 149597870700.0**3, rel=1e-15)
    si = UNIT_SYSTEMS["si"]
    assert quantity("1 Msun", "mass", si) * si.gravity == pytest.approx(1.32712440040944e20, rel=1e-15)
    assert quantity("1 AU", "length", astro) == 1
    assert quantity("6.6743e-11 m3/kg/s2", "gravitational constant", astro) == pytest.approx(astro.gravity, rel=1e-12)


def test_coherent_mass_of_metal():
    assert METAL.coherent_mass == pytest.approx(1.0364269667e-4, rel=1e-10)
    # 1/2 m v^2 of 1 u at 1 angstrom/ps = 100 m/s
    assert 0.5 * METAL.coherent_mass == pytest.approx(quantity("0.5 u m2/s2", "energy", METAL) * 1e4, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "between", "k", "coherent"),
    [  # Coulomb's constant and k_B by e, k_B, N_A (exact since 2019) and CODATA 2022's u and vacuum permittivity
        ("real", 332.0637130741, 1.987204258641e-3, 2390.0573638900),
        ("gromacs", 138.9354575502, 8.31446261815324e-3, 1.00000000105),
    ],
)
def test_units_of_biomolecules(name, between, k, coherent):
    """LAMMPS has 332.06371 and 1/48.88821291^2 = 1/2390.0573614; GROMACS has 138.935458 and 0.0083144626."""
    units = UNIT_SYSTEMS[name]
    assert units.coulomb == pytest.approx(between, rel=1e-11)
    assert units.boltzmann == pytest.approx(k, rel=1e-12)
    assert units.coherent_mass == pytest.approx(coherent, rel=1e-10)


@pytest.mark.parametrize(
    ("text", "dimension", "real", "gromacs"),
    [
        ("0.24 kcal/mol", "energy", 0.24, 0.24 * 4.184),
        ("1 kJ/mol", "energy", 1 / 4.184, 1.0),
        ("1 eV", "energy", 23.0605478306, 96.4853321233),
        ("120 K", "energy", 120 * 1.987204258641e-3, 120 * 8.31446261815324e-3),
        ("1 atm", "pressure", 1.458397257426e-5, 0.0610193412507),  # LAMMPS: 1/68568.415
        ("1 bar", "pressure", 1.439326185468e-5, 0.0602214076),  # GROMACS: 1/16.6054
        ("4.5e-5 bar^-1", "compressibility", 4.5e-5 / 1.439326185468e-5, 4.5e-5 / 0.0602214076),
        ("31 kcal/mol/angstrom^2", "stiffness", 31.0, 31.0 * 418.4),
        ("2 fs", "time", 2.0, 0.002),
        ("3 angstrom", "length", 3.0, 0.3),
        ("1 e", "charge", 1.0, 1.0),
    ],
)
def test_quantities_of_biomolecules(text, dimension, real, gromacs):
    assert quantity(text, dimension, UNIT_SYSTEMS["real"]) == pytest.approx(real, rel=1e-10)
    assert quantity(text, dimension, UNIT_SYSTEMS["gromacs"]) == pytest.approx(gromacs, rel=1e-10)


@pytest.mark.parametrize(
    ("value", "dimension", "message"),
    [
        ("3.4 K", "length", "cutoff: expected a length such as \"3.4 angstrom\", got '3.4 K'"),
        ("3.4", "length", "cutoff: missing unit in '3.4'; expected a length such as \"3.4 angstrom\""),
        ("3.4 angstrm", "length", "cutoff: unknown unit 'angstrm'; did you mean 'angstrom'? in '3.4 angstrm'"),
        ("12 eV", "temperature", "cutoff: expected a temperature such as \"94.4 K\", got '12 eV'"),
        ("far", "length", "cutoff: expected a length such as \"3.4 angstrom\", got 'far'"),
        ("nan m", "length", "cutoff: expected a length such as \"3.4 angstrom\", got 'nan m'"),
        ("1e400 m", "length", "cutoff: '1e400 m' is out of range"),
        (float("nan"), "length", "cutoff: expected a finite number, got nan"),
        (10**400, "length", "cutoff: expected a finite number, got 1000"),
        (True, "length", 'cutoff: expected a length such as "3.4 angstrom", got True'),
        (None, "energy", 'cutoff: expected an energy such as "0.0103 eV", got None'),
        ("1 m**(9**9**9)", "length", "cutoff: cannot read the unit 'm**(9**9**9)'"),
        ("1 __import__('os')", "length", "cutoff: cannot read the unit"),
        ("2", "dimensionless", "cutoff: expected a plain number, got '2'"),
    ],
)
def test_bad_quantities_are_one_line_that_names_the_key(value, dimension, message):
    with pytest.raises(InputError) as error:
        quantity(value, dimension, METAL, "cutoff")
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


PIECES = ["m", "K", "mol", "°C", "cm3", "s-1", "^", "**", "2", "-1", "(", ")", "*", "/", "1/", " ", "%", "e"]


@given(st.text() | st.lists(st.sampled_from(PIECES)).map("".join))
@settings(deadline=None)
def test_any_text_is_a_finite_number_or_an_input_error(text):
    for value in (text, f"1 {text}"):
        try:
            number = quantity(value, "length", METAL)
        except InputError as error:
            number, line = 0.0, str(error)
        else:
            line = ""
        assert abs(number) < float("inf")
        assert "\n" not in line


@pytest.mark.parametrize("name", ["lj", "nbody"])
def test_reduced_systems_take_plain_numbers_only(name):
    assert quantity(2.5, "length", UNIT_SYSTEMS[name]) == 2.5
    with pytest.raises(InputError, match=f"cutoff: {name} quantities are plain numbers, got '2.5 angstrom'"):
        quantity("2.5 angstrom", "length", UNIT_SYSTEMS[name], "cutoff")


def test_number_density_takes_a_mass_density():
    expected = 1.374 / (39.948 * 1.66053906892)
    assert number_density("1.374 g/cm3", METAL, 39.948) == pytest.approx(expected, rel=1e-12)
    assert number_density("21 nm-3", METAL, 39.948) == pytest.approx(0.021, rel=1e-12)
    assert number_density(0.8442, LJ, 2.0) == 0.8442
    with pytest.raises(InputError, match="density: expected a density"):
        number_density("3 K", METAL, 1.0)


def test_unknown_names():
    with pytest.raises(InputError, match=r"units: expected one of lj, metal, .*; did you mean 'metal'\?"):
        unit_system("metl")
    with pytest.raises(ValueError, match="dimension 'size' is not one of"):
        quantity(1.0, "size", METAL)
    assert suggestion("Lennard-jone", ["gravity", "lennard-jones"]) == "; did you mean 'lennard-jones'?"
    assert suggestion("xyz", ["gravity"]) == ""


def test_pint_is_imported_only_for_text():
    code = (
        "import sys; from kickdrift.model.units.quantities import *; quantity(1.0, 'length', UNIT_SYSTEMS['metal'])\n"
        "assert 'pint' not in sys.modules and 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_constants_are_those_of_scipy():
    """Exact constants agree; others agree to the digits that differ between years of CODATA."""
    pairs = {
        "BOLTZMANN": "k", "ELEMENTARY_CHARGE": "e", "LIGHT": "c", "AVOGADRO": "N_A", "AU": "astronomical_unit",
        "DAY": "day",
    }  # fmt: skip
    for name, scipys in pairs.items():
        assert getattr(constants, name) == getattr(scipy.constants, scipys)
    assert pytest.approx(scipy.constants.atomic_mass, rel=1e-9) == constants.ATOMIC_MASS
    assert pytest.approx(scipy.constants.G, rel=5e-5) == constants.GRAVITY
