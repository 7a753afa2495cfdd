"""Energies and virials of NIST's Lennard-Jones reference configurations, to the digits that NIST prints.

Configurations 2 (200 particles) and 4 (30 particles) of the NIST Standard Reference Simulation Website, in cubes of
8 sigma, cut at 3 and at 4 sigma (half the edge, the hardest case for any list): plain cut, linear force shift
(truncation "force-shift"), and the correction for what lies beyond the cutoff. Data and source: data/nist-lj.
The same numbers recomputed in double precision stand in the data too, and are met to round-off.
"""

import json

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, largest, main
from kickdrift_validation.folders import DATA

NIST = DATA / "nist-lj"
ROUND_OFF = 1e-12  # relative
SOURCE = "NIST SRSW, configuration"


def positions(number: str) -> tuple[np.ndarray, list[float]]:
    """(n, 3) positions of a configuration, and the edges of its box."""
    lines = (NIST / f"lj_sample_config_periodic{number}.txt").read_text(encoding="utf-8").splitlines()
    edges = [float(word) for word in lines[0].split()]
    return np.array([[float(word) for word in line.split()[1:4]] for line in lines[2:] if line.strip()]), edges


def measured(number: str, **force: object) -> tuple[float, float]:
    """Energy and virial (sum of r . F over pairs) of a configuration at rest."""
    x, edges = positions(number)
    sim = kd.Simulation(kd.System(x, box=edges, forces=[kd.LennardJones(**force)]), dt=0.005)
    sample = sim.sample()
    return sample.energies.potential, sample.pressure * 3 * float(np.prod(edges))


def matches(value: float, printed: float, digits: int = 5) -> bool:
    """Whether a value rounds to what is printed with that many digits."""
    return float(f"{value:.{digits - 1}e}") == printed


def claims(long: bool = False) -> list[Claim]:
    """One entry for each published number, and one for the worst deviation from the recomputed ones."""
    rows: list[Claim] = []
    worst = 0.0
    for number, expected in json.loads((NIST / "reference.json").read_text(encoding="utf-8")).items():
        kinds = {"cut": "cut", "shift": "shift", "lfs": "force-shift"}
        for kind, cutoff in ((kind, cutoff) for kind in kinds for cutoff in (3, 4)):
            key = f"{kind}{cutoff}"
            energy, virial = measured(number, cutoff=float(cutoff), truncation=kinds[kind])
            values = {f"energy, {key}": energy, f"virial, {key}": virial}
            exact = expected[key]
            worst = largest(worst, abs(energy / exact["U"] - 1), abs(virial / exact["W"] - 1))
            published = expected["published"].get(key, [])
            if kind == "cut":
                with_tail, _ = measured(number, cutoff=float(cutoff), truncation="cut", tail=True)
                values[f"long-range correction, {key}"] = with_tail - energy
                worst = largest(worst, abs((with_tail - energy) / expected[f"lrc{cutoff}"]["U"] - 1))
            for (name, value), printed in zip(values.items(), published, strict=False):
                holds = matches(value, printed)
                rows.append(claim(name, f"{value:.7g}", f"{printed:g} to 5 digits", holds, f"{SOURCE} {number}"))
    text = "energies, virials and corrections, largest relative deviation"
    rows.append(at_most(text, worst, ROUND_OFF, "recomputed in double precision"))
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
