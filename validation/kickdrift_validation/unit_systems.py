"""Constants and conversions of the unit systems beside ASE's, which has tables of CODATA of its own.

ASE's tables end with CODATA 2018; SciPy's, which kickdrift has its constants from, may be of 2022. Between the two the
atomic mass moved by 1.4e-9, which is what the bound leaves room for. The Sun's GM is held against the Gaussian
gravitational constant k = 0.01720209895 (Gauss 1809; IAU 1976) and the nominal value of IAU 2015 resolution B3, which
has eight digits.
"""

from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift_validation.claim import Claim, at_most, main, not_run

NEAR = 2e-9
CODATA = "2018"
METAL, SI, ASTRO = (UNIT_SYSTEMS[name] for name in ("metal", "si", "astro"))
EXACT = "SI since 2019: k = 1.380649e-23 J/K, e = 1.602176634e-19 C, c = 299792458 m/s"
AU, YEAR = 149597870700.0, 365.25 * 86400.0  # m, IAU 2012; s


def near(text: str, value: float, exact: float, reference: str, bound: float = NEAR) -> Claim:
    return at_most(f"{text}: relative difference", abs(value / exact - 1.0), bound, reference)


def defined() -> list[Claim]:
    """What the SI and the IAU define."""
    k, e, c = 1.380649e-23, 1.602176634e-19, 299792458.0
    return [
        near("si: Boltzmann's constant", SI.boltzmann, k, EXACT, 1e-15),
        near("metal: Boltzmann's constant", METAL.boltzmann, k / e, EXACT, 1e-15),
        *(near(f"{units.name}: speed of light", units.light or 0.0, exact, EXACT, 1e-15)
          for units, exact in ((SI, c), (METAL, c * 1e-2), (ASTRO, c * YEAR / AU))),
        near("si: gravitational constant", SI.gravity or 0.0, 6.67430e-11, "CODATA 2018 and 2022, six digits"),
        near("astro: G, from the Sun's GM", ASTRO.gravity or 0.0, (0.01720209895 * 365.25) ** 2, "Gauss' k"),
        near("astro: G, from the Sun's GM", ASTRO.gravity or 0.0, 1.3271244e20 * YEAR**2 / AU**3, "IAU 2015 B3"),
    ]  # fmt: skip


def beside_ase() -> list[Claim]:
    """Where a u, an angstrom and an eV are 1, as in ASE, the unit of time follows."""
    from ase.units import create_units

    ase = create_units(CODATA)
    reference = f"ASE, CODATA {CODATA}"
    ps = 1000.0 * ase["fs"]
    rows = [
        near("metal: u angstrom^2 / ps^2 in eV", METAL.coherent_mass, 1.0 / ps**2, reference),
        near("metal: k_B in eV / K", METAL.boltzmann, ase["kB"], reference),
    ]
    per_time = METAL.coherent_mass**0.5 * ps  # 1 but for what the first line allows
    for text, dimension, exact in (
        ("39.948 u", "mass", 39.948),
        ("1 kg", "mass", ase["kg"]),
        ("0.238 kcal/mol", "energy", 0.238 * ase["kcal"] / ase["mol"]),
        ("1 hartree", "energy", ase["Hartree"]),
        ("120 K", "energy", 120.0 * ase["kB"]),
        ("10 fs", "time", 10.0 * ase["fs"] / ps * per_time),
        ("1 bar", "pressure", ase["bar"]),
        ("3.5 GPa", "pressure", 3.5 * ase["GPa"]),
        ("300 m/s", "velocity", 300.0 * ase["m"] / ase["s"] * ps),
        ("1.374 g/cm3", "density", 1.374e-3 * ase["kg"] / (1e-2 * ase["m"]) ** 3),
    ):
        rows.append(near(f"metal: {text}", quantity(text, dimension, METAL), exact, reference))
    return rows


def claims(long: bool = False) -> list[Claim]:
    try:
        return [*defined(), *beside_ase()]
    except ModuleNotFoundError:
        return [*defined(), not_run("metal: constants and conversions", f"at most {NEAR:g}", "ASE")]


if __name__ == "__main__":
    main(claims, __doc__)
