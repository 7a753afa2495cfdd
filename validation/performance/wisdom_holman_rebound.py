"""Is a Wisdom-Holman step at least three times as fast as rebound's WHFast at the same error?

    python validation/performance/wisdom_holman_rebound.py [--turns 11] [--steps 100000]

The Sun and eight planets (JPL DE421), one core, the same coordinates and the same step, a hundredth and a twentieth of
Mercury's period; WHFast with safe_mode 0, so that both join half drifts. They take turns (A B A B …) in one process,
each so many steps, and end synchronised; the figure is the median of the ratios of neighbouring turns. That the map is
the same, and with it the error, is validation/wisdom_holman.py's to show; the RMS energy errors are printed beside.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from time import process_time

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claim import Claim, claim, not_run, show, where
from exact_reversal import solar_system
from wisdom_holman import COORDINATES, MERCURY, NEEDED, energy, theirs, whfast

import kickdrift as kd

TURNS, STEPS, BOUND = 11, 100_000, 3.0


def compare(coordinates: str, parts: int, turns: int, steps: int) -> Claim:
    """The ratio of WHFast's processor time to ours, with both times and errors."""
    system, dt = solar_system(), MERCURY / parts
    ours, rebounds = (
        kd.Simulation(system, "wisdom-holman", dt=dt, coordinates=coordinates),
        whfast(system, dt, coordinates),
    )
    ours.run(100, every=100)
    rebounds.steps(100)
    times, errors = np.zeros((turns, 2)), np.zeros((turns, 2))
    for k in range(turns):
        began = process_time()
        ours.run(steps, every=steps)
        between = process_time()
        rebounds.steps(steps)
        x, v = theirs(rebounds)
        times[k] = between - began, process_time() - between
        state = ours.state
        errors[k] = energy(system, state.positions, state.velocities), energy(system, x, v)
    mine, other = 1e6 * np.median(times, axis=0) / steps
    ratios = times[:, 1] / times[:, 0]
    ratio, rms = float(np.median(ratios)), np.sqrt((errors**2).mean(axis=0))
    print(
        f"  {coordinates:24} P / {parts:<4} {mine:.3f} us a step, WHFast {other:.3f}; ratio {ratio:.2f} "
        f"({ratios.min():.2f} to {ratios.max():.2f}); RMS energy error {rms[0]:.4e}, WHFast {rms[1]:.4e}"
    )
    text = f"WHFast's time over ours, {coordinates}, dt = P / {parts}"
    return claim(text, ratio, f"at least {BOUND:g}", ratio >= BOUND, "rebound 5.2.2, whfast, safe_mode 0")


def compare_all(turns: int = TURNS, steps: int = STEPS) -> list[Claim]:
    """Both coordinates and two steps."""
    try:
        import rebound  # noqa: F401
    except ImportError:
        return [not_run("WHFast's time over ours", f"at least {BOUND:g}", "rebound", NEEDED)]
    print(where("rebound"))
    return [compare(coordinates, parts, turns, steps) for parts in (100, 20) for coordinates in COORDINATES]


def claims() -> list[Claim]:
    """With the default options."""
    return compare_all()


def main() -> int:
    """Compare with the given options and print the claims."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=TURNS, help="of each")
    parser.add_argument("--steps", type=int, default=STEPS, help="in a turn")
    given = parser.parse_args()
    return show(compare_all(given.turns, given.steps))


if __name__ == "__main__":
    sys.exit(main())
