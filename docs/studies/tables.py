"""Speed of tables beside Lennard-Jones, in turns in one process: ``python -m docs.studies.tables``.

1000 particles at rho* = 0.8442, one thread, processor time of 500 steps, the median ratio of nine turns.
"""

import time
from statistics import median

import kickdrift as kd

STEPS, TURNS, START = 500, 9, 0.6


def sides(truncation: str, mixture: bool) -> list[kd.Simulation]:
    """A melted liquid under the formula and under its table."""
    start = kd.load("lj-1000")
    kinds = {"species": {"A": {}, "B": {"epsilon": 0.5, "sigma": 0.88}}} if mixture else {}
    law = kd.LennardJones(cutoff=2.5, truncation=truncation, **kinds)
    species = ["AB"[k % 5 == 0] for k in range(len(start))] if mixture else None
    x, v = start.state.positions, start.state.velocities
    system = kd.System(x, v, 1.0, start.box, [law], "lj", species=species)
    sim = kd.Simulation(system, "velocity-verlet", 0.004, threads=1)
    sim.run(1000)
    melted = system.at(sim.state.phase, 0.0)
    forces = (law, kd.Tabulated.of(law, START))
    return [kd.Simulation(melted.with_forces(each), "velocity-verlet", 0.004, threads=1) for each in forces]


def main() -> None:
    """Print a row for each truncation, of one species and of two."""
    print("| species | truncation | formula, us a step | table, us a step | ratio |\n| --- | --- | --- | --- | --- |")
    for mixture in (False, True):
        for truncation in ("shift", "force-shift", "switch"):
            both = sides(truncation, mixture)
            times: list[list[float]] = [[], []]
            for turn in range(TURNS + 1):
                for sim, found in zip(both, times, strict=True):
                    begun = time.process_time()
                    sim.run(STEPS)
                    if turn:  # the first is compiled and warmed up
                        found.append(time.process_time() - begun)
            ratio = median(table / law for law, table in zip(*times, strict=True))
            law, table = (1e6 * median(each) / STEPS for each in times)
            print(f"| {1 + mixture} | `{truncation}` | {law:.0f} | {table:.0f} | {ratio:.2f} |", flush=True)


if __name__ == "__main__":
    main()
