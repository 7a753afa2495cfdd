"""Ten faults that the validation must find, fixed before its claims were written; faults.py plants them.

Three (marked small) change no result by more than a millionth: digits swapped in a weight, an older value of the atomic
mass, a series used past its range.
"""

from typing import NamedTuple


class Fault(NamedTuple):
    """One text in one file of the package (which must stand there once), and what takes its place."""

    name: str
    what: str
    file: str
    text: str
    wrong: str
    small: bool = False


FAULTS = (
    Fault(
        "yoshida-weight", "two digits of a weight of yoshida6 swapped, 9e-8 of it", "integrators/splitting/method.py",
        "0.23557321335935813", "0.23557312335935813", small=True,
    ),
    Fault(
        "half-kick", "the last kick of a splitting step left out", "integrators/splitting/words.py",
        "    return np.array(stages, dtype=np.float64).T",
        "    stages[-1][0] = 0.0\n    return np.array(stages, dtype=np.float64).T",
    ),
    Fault(
        "virial-sign", "the virial of the pair forces with the wrong sign", "forces/pairs/sum.py",
        "sums[c, 1] = lane_sum(virial_sum)", "sums[c, 1] = -lane_sum(virial_sum)",
    ),
    Fault(
        "unit-factor", "metal's atomic mass unit of CODATA 2002, 1.2e-7 off", "model/units/unit_systems.py",
        "coherent_mass=constants.ATOMIC_MASS *", "coherent_mass=1.66053886e-27 *", small=True,
    ),
    Fault(
        "tableau", "-212 / 729 in dormand-prince45 copied as -212 / 792", "integrators/runge_kutta/tableaus.py",
        "-212 / 729", "-212 / 792",
    ),
    Fault(
        "tail", "the energy from beyond the cutoff counted for half of the pairs", "forces/pairs/law.py",
        "energy += density * u_part", "energy += 0.5 * density * u_part",
    ),
    Fault(
        "switch-slope", "a factor of two lost in the switch's derivative", "forces/pairs/truncation.py",
        "slope = 1260.0 *", "slope = 630.0 *",
    ),
    Fault(
        "relativity-sign", "the second term of the 1PN acceleration with the wrong sign", "forces/around/relativity.py",
        "4.0 * scale * (d @ u)", "-4.0 * scale * (d @ u)",
    ),
    Fault(
        "late-list", "the pair list refreshed after a whole skin instead of half of one", "forces/lists/pairlist.py",
        "if room >= 0.0 and 4.0 * inner <= room**2:", "if room >= 0.0 and inner <= room**2:",
    ),
    Fault(
        "kepler-series", "the series of Kepler's problem used to ten times its range",
        "integrators/wisdom_holman/kepler.py",
        "SERIES = 0.7 ", "SERIES = 7.0 ", small=True,
    ),
)  # fmt: skip
