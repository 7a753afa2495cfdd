"""Strong and weak scaling on this machine, and a model of more cores.

    python -m docs.studies.scaling [--turns 5] [--json FILE] [--page docs/scaling.md]

The liquid is that of liquids.py; the stars are those of the group plummer-100000. Runs on one and on more threads take
turns. A speed-up is the median of the ratios of neighbouring turns. ``scaling_model`` predicts the same numbers from
one thread and from the delays between two threads. ``scaling_engine`` times LAMMPS through the engine.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import kickdrift as kd
from docs.studies import scaling_engine
from docs.studies.scaling_model import (
    AWAKE,
    Delays,
    Log,
    Memory,
    delays,
    log_of,
    memory_of,
    memory_rate,
    predicted,
)
from kickdrift.forces.bound.forces import most_threads
from kickdrift_validation.claim import where
from kickdrift_validation.docs_tables import deliver, outputs, table
from kickdrift_validation.performance.bodies import by_tree, tree_stars
from kickdrift_validation.performance.liquids import again, melt
from kickdrift_validation.performance.turns import Missing, Native, ratio_of, turns

BEGIN, END = "<!-- scaling.py writes from here -->", "<!-- to here -->"
SIDES = (10, 22, 46, 100)  # liquids of side^3 particles
WEAK_SIDES = (16, 22, 46)  # on each thread
MORE = (4, 8, 16, 32, 64)
STARS, ACCURACY = 100_000, 1e-2
LOGGED = 4_000_000  # particle steps in a log
TREE = f"{STARS:,} stars, tree"


def steps_for(n: int, most: int = 500) -> int:
    """Steps until the lattice is a liquid; fewer for large systems, whose cost differs little."""
    return min(most, max(60, 10**7 // n))


def counts() -> list[int]:
    """Numbers of threads: powers of two, up to all cores."""
    cores = min(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1, most_threads())
    return sorted({1, *(2**k for k in range(1, cores.bit_length()) if 2**k <= cores), cores})


def liquid_on(n: int) -> Callable[[int], kd.Simulation]:
    """The liquid, as a function of the number of threads."""
    start = melt(n, steps_for(n), threads=counts()[-1])
    return partial(again, start)


def stars_on(threads: int) -> kd.Simulation:
    return by_tree(tree_stars(STARS), ACCURACY, threads).sim


class Study:
    """Measurements and predictions with the same turns; ``delay`` is None on a machine without two free cores."""

    def __init__(self, count: int, seconds: float) -> None:
        self.count, self.seconds, self.why = count, seconds, ""
        self.rates = {p: memory_rate(p) for p in counts()}
        self.delay: Delays | None = None
        try:
            self.delay = delays()
        except Missing as missing:
            self.why = str(missing)

    def log(self, make: Callable[[int], kd.Simulation], n: int) -> Log | None:
        """Log of a run's chunks; None where there is no model."""
        return None if self.delay is None else log_of(make(2), max(3, LOGGED // n))

    def strong(self, name: str, n: int, make: Callable[[int], kd.Simulation], listed: bool) -> dict[str, Any]:
        """Steps a second on each number of threads, the speed-ups and the model's."""
        sims = [make(threads) for threads in counts()]
        speeds = turns([Native(sim, least=1.0) for sim in sims], self.seconds, self.count)
        whole = float(1e9 / np.median(speeds[:, 0]))
        log = self.log(make, n)
        memory = memory_of(sims[0], max(self.rates.values())) if listed else None
        found = {"name": name, "particles": n, "nanoseconds": whole, "threads": counts()}
        found["speed_ups"] = [ratio_of(speeds[:, k], speeds[:, 0])._asdict() for k in range(len(sims))]
        return found | self.model(log, whole, memory)

    def model(self, log: Log | None, whole: float, memory: Memory | None) -> dict[str, Any]:
        """Parameters of a step and the model's speed-ups."""
        if log is None or self.delay is None:
            return {}
        log = log.scaled(whole)
        of = {p: whole / predicted(log, p, self.delay, memory) for p in (*counts(), *MORE)}
        free = {p: whole / predicted(log, p, self.delay) for p in MORE}
        return {
            "model": of,
            "model_without_memory": free,
            "serial": log.serial / whole,
            "tasks": sum(task.often for task in log.tasks),
            "asleep": sum(task.often for task in log.tasks if task.before > AWAKE),
            "chunks": max(len(task.chunks) for task in log.tasks),
            "memory": memory._asdict() if memory else None,
        }

    def weak(self, side: int) -> dict[str, Any]:
        """Efficiency with the same number of particles on each thread."""
        sizes = [round(side * p ** (1 / 3)) ** 3 for p in counts()]
        makes = [liquid_on(n) for n in sizes]
        sims = [make(p) for make, p in zip(makes, counts(), strict=True)]
        rates = turns([Native(sim, least=1.0) for sim in sims], self.seconds, self.count) * np.array(sizes)
        per_thread = rates / np.array(counts())
        found = {"particles": sizes, "threads": counts(), "nanoseconds": 1e9 / float(np.median(rates[:, 0]))}
        found["efficiency"] = [ratio_of(per_thread[:, k], per_thread[:, 0])._asdict() for k in range(len(sims))]
        if self.delay is None:
            return found
        one = sizes[0] * found["nanoseconds"]
        found["model"] = {}
        for make, n, p in list(zip(makes, sizes, counts(), strict=True))[1:]:
            log = log_of(make(2), max(3, LOGGED // n))
            step = predicted(log.scaled(n * found["nanoseconds"]), p, self.delay)
            found["model"][p] = n / (step * p) / (sizes[0] / one)
        return found


def study(count: int = 5, seconds: float = 0.5) -> dict[str, Any]:
    """Everything, as one object for JSON."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    work = Study(count, seconds)
    found: dict[str, Any] = {"where": where(), "load_before": load, "turns": count, "seconds": seconds}
    found |= {"delays": work.delay._asdict() if work.delay else None, "why": work.why, "rates": work.rates}
    found["strong"] = []
    for side in SIDES:
        found["strong"].append(work.strong(f"{side**3:,} particles", side**3, liquid_on(side**3), listed=True))
        print(f"strong scaling: {side**3} particles", flush=True)
    found["strong"].append(work.strong(TREE, STARS, stars_on, listed=False))
    print("strong scaling: stars", flush=True)
    found["weak"] = [work.weak(side) for side in WEAK_SIDES]
    print("weak scaling", flush=True)
    found["engine"] = scaling_engine.measured(count, seconds)
    return json.loads(json.dumps(found))


def spread(ratio: dict[str, float]) -> str:
    return f"{ratio['median']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f})"


def apart(model: float, measured: float) -> str:
    """How far the model is from a measurement."""
    return f"{100 * (model / measured - 1):+.0f} %"


def strong_table(found: dict[str, Any]) -> str:
    rows = []
    for each in found["strong"]:
        for k, p in enumerate(each["threads"][1:], 1):
            measured, model = each["speed_ups"][k], each.get("model", {}).get(str(p))
            rows.append([
                each["name"], f"{each['nanoseconds'] / each['particles']:.1f}", str(p), spread(measured),
                f"{model:.2f}" if model else "–", apart(model, measured["median"]) if model else "–",
            ])  # fmt: skip
    heading = ["system", "ns a particle and step alone", "threads", "speed-up, measured", "model", "model's error"]
    return table(heading, rows)


def weak_table(found: dict[str, Any]) -> str:
    rows = []
    for each in found["weak"]:
        for k, p in enumerate(each["threads"][1:], 1):
            model = each.get("model", {}).get(str(p))
            rows.append([
                f"{each['particles'][0]:,}", str(p), f"{each['particles'][k]:,}", spread(each["efficiency"][k]),
                f"{model:.2f}" if model else "–",
            ])  # fmt: skip
    return table(["particles, one thread", "threads", "particles, all threads", "efficiency, measured", "model"], rows)


def parameters_table(found: dict[str, Any]) -> str:
    heading = ["system", "serial share", "tasks a step", "of these with sleeping helpers", "most chunks of a task",
               "bytes a particle and step", "arrays, MB"]  # fmt: skip
    rows = []
    for each in found["strong"]:
        if "model" not in each:
            continue
        memory = each["memory"]
        rows.append([
            each["name"], f"{100 * each['serial']:.1f} %", f"{each['tasks']:.1f}", f"{each['asleep']:.2f}",
            str(each["chunks"]), f"{memory['streamed'] / each['particles']:.0f}" if memory else "–",
            f"{1e-6 * memory['arrays']:.1f}" if memory else "–",
        ])  # fmt: skip
    return table(heading, rows)


def model_table(found: dict[str, Any]) -> str:
    """Speed-ups on more cores than were measured."""
    rows = []
    for each in found["strong"]:
        if "model" in each:
            cells = []
            for p in MORE:
                limited, free = each["model"][str(p)], each["model_without_memory"][str(p)]
                cells.append(f"{limited:.1f}" + (f" ({free:.1f})" if free > 1.01 * limited else ""))
            rows.append([each["name"], *cells])
    return table(["**model**", *(f"{p} cores" for p in MORE)], rows)


def engine_table(found: dict[str, Any]) -> str:
    """LAMMPS, alone and through the engine."""
    engine = found["engine"]
    rows = [[row["name"], f"{row['speed']:.4g}", spread(row["ratio"])] for row in engine["rows"]]
    return table([f"LAMMPS, {engine['particles']:,} particles", "steps/s", "over LAMMPS alone"], rows)


def text_of(found: dict[str, Any]) -> str:
    rates = ", ".join(f"{rate:.1f} GB/s on {p}" for p, rate in found["rates"].items())
    head = (
        f"{found['where']}; {found['turns']} turns of {found['seconds']:g} s; the load of the machine before was "
        f"{found['load_before'] or 0:.1f}."
    )
    parts = [head, "### Strong scaling", strong_table(found), "### Weak scaling", weak_table(found)]
    engine = found["engine"]
    parts += ["### LAMMPS through the engine", engine_table(found) if engine["rows"] else ""]
    parts += [f"Left out: {each}." for each in engine["left_out"]]
    if found["delays"]:
        late = found["delays"]
        parts += [
            "### Parameters of the model",
            f"Measured delays: {late['master']:.0f} ns until the calling thread begins a task, {late['awake']:.0f} ns "
            f"until an awake helper does, {late['asleep'] / 1000:.0f} µs until a sleeping helper does, and "
            f"{late['end']:.0f} ns from the last chunk to the task's end. Threads read from memory: {rates}.",
            parameters_table(found),
            "### The model for more cores",
            model_table(found),
        ]
    else:
        parts.append(f"No model: {found['why']}.")
    return "\n\n".join(part for part in parts if part)


def main() -> int:
    """Measure with the given options and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=5, help="of each measurement")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a turn")
    outputs(parser)
    given = parser.parse_args()
    found = study(given.turns, given.seconds)
    deliver(given, found, text_of(found), BEGIN, END)
    return 0


if __name__ == "__main__":
    sys.exit(main())
