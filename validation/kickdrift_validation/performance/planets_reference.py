"""Write data/solar-system/sun-and-planets-100yr.json: Sun and planets after a hundred years, in binary128.

    python -m kickdrift_validation.performance.planets_reference    takes some minutes and needs heyoka

heyoka's Taylor method (Biscani & Izzo 2021, doi:10.1093/mnras/stab1032) runs at the tolerance of binary128, from the
float64 numbers with which all programs of bodies.py begin. The same run in extended precision differs a little. The
file keeps the difference, which shows how well the positions are known.
"""

import json
import sys
from typing import Any

import heyoka
import numpy as np

from kickdrift_validation.exact_reversal import solar_system
from kickdrift_validation.folders import DATA

TIME = 100.0  # years
TARGET = DATA / "solar-system" / "sun-and-planets-100yr.json"


def positions(kind: Any) -> list[list[Any]]:
    """Positions at the end, (9, 3), in this kind of numbers."""
    system = solar_system()
    state, count = system.state, len(system)
    bodies = heyoka.model.nbody(
        count, masses=[kind(m) for m in state.masses.tolist()], Gconst=kind(float(system.units.gravity))
    )
    start = np.array([kind(value) for value in np.hstack([state.positions, state.velocities]).ravel().tolist()])
    taylor = heyoka.taylor_adaptive(bodies, start, fp_type=kind, compact_mode=True)
    taylor.propagate_until(kind(TIME))
    return [[taylor.state[6 * body + k] for k in range(3)] for body in range(count)]


def main() -> int:
    """Run in both precisions and write the file."""
    found, check = positions(heyoka.real128), positions(np.longdouble)
    apart = max(
        abs(float(a - heyoka.real128(str(b))))
        for x, y in zip(found, check, strict=True)
        for a, b in zip(x, y, strict=True)
    )
    content = {
        "what": "Sun, planets (the Earth with the Moon) of de421.json under Newton's gravity, AU, years, solar masses",
        "source": f"heyoka {heyoka.__version__}, Taylor's method in binary128 (planets_reference.py)",
        "apart_in_extended_precision": apart,
        "time": TIME,
        "positions": [[float(value) for value in body] for body in found],
    }
    TARGET.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    print(f"{TARGET}: in extended precision {apart:.1e} apart")
    return 0


if __name__ == "__main__":
    sys.exit(main())
