"""Speed of kickdrift beside every other installed program, on the same systems.

    python -m kickdrift_validation.performance.speed [--only GROUP …] [--turns 7] [--seconds 0.4]
    kickdrift bench speed                   the same with tables, and --json FILE

All programs of a group begin with the same numbers and use the same number of threads. After warming up they take turns
(A B C A B C …) in one process, so that other load of the machine falls on all of them. A figure is the median over the
rounds of the ratio of kickdrift's speed to the other's, with quartiles.

Before the turns, each program runs over the same length of physical time. A slow program runs over a shorter time,
which the table states. One function computes the energies of all programs, from their positions and velocities, in
float64 or better. So no program gains speed by lower accuracy unseen. With fixed steps, positions must agree after ten
steps, or a program is left out. Programs with a heat bath are only timed, because each has its own noise.

Timings exclude compilation, set-up and file reading, for every program. groups.py lists the programs and the goals.
Among several styles of one program the fastest counts.
"""

import argparse
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import kickdrift
from kickdrift.analysis.compare.bench import processor
from kickdrift.errors import InputError, RunError
from kickdrift_validation.claim import Claim, at_most, claim, not_run, show, text_of
from kickdrift_validation.performance.groups import ENTRIES, Command, Contestant, Goal, Group
from kickdrift_validation.performance.turns import Missing, Runner, ratio_of, turns

TURNS, SECONDS = 7, 0.4
AGREE_STEPS, AGREE_SINGLE = 10, 1e-4  # steps, and how far positions may then differ in float32; see Group.agree
MOST = 1.2  # bound for the ratio of RMS energy errors, which vary between sets of few starts
Tell = Callable[[str], Callable[[int, int], object]]


def chosen(names: Sequence[str] = ()) -> list[Group | Command]:
    """Return the entries with these names, or the default entries. Raises InputError for an unknown name."""
    known = {entry.name: entry for entry in ENTRIES}
    for name in names:
        if name not in known:
            raise InputError(f"bench speed: {name!r} is no group; there are: {', '.join(known)}")
    return [entry for entry in ENTRIES if (entry.name in names if names else entry.usual)]


def listed() -> tuple[list[str], list[list[str]]]:
    """Columns and rows of a table of all entries."""
    rows = [[entry.name, "yes" if entry.usual else "", entry.title] for entry in ENTRIES]
    return ["group", "by default", "what"], rows


def expected_seconds(entries: Sequence[Group | Command], count: int, seconds: float) -> float:
    """Estimate of the time, with everything compiled beforehand."""
    contestants = sum(len(entry.contestants) for entry in entries if isinstance(entry, Group))
    return sum(entry.overhead for entry in entries) + contestants * (count + 2) * max(seconds, 0.1)


def measure(
    entries: Sequence[Group | Command], count: int = TURNS, seconds: float = SECONDS,
    tell: Tell = lambda label: lambda done, of: None,
) -> dict[str, Any]:  # fmt: skip
    """Measure all entries and return one object for JSON. ``tell(name)`` returns a function that shows progress."""
    began, load = perf_counter(), os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    groups = []
    for entry in entries:
        at = perf_counter()
        each = timed(entry, max(3, count // 2)) if isinstance(entry, Command) else compared(entry, count, seconds, tell)
        groups.append(each | {"wall_seconds": perf_counter() - at})
    return {
        "benchmark": "speed",
        "processor": processor(),
        "cores": os.cpu_count(),
        "simd": widest_simd(),
        "load_before": load,
        "versions": {name: version(name) for name in ("kickdrift", "numpy", "numba")}
        | {"python": platform.python_version()},
        "turns": count,
        "seconds": seconds,
        "wall_seconds": perf_counter() - began,
        "groups": groups,
    }


def widest_simd() -> str:
    """Widest vectors of this processor, by LLVM's names."""
    from llvmlite.binding import get_host_cpu_features

    features = get_host_cpu_features()
    return next((name for name in ("avx512f", "avx2", "avx", "sse2", "sve", "neon") if features.get(name)), "none")


def compared(group: Group, count: int, seconds: float, tell: Tell) -> dict[str, Any]:
    """Measure a group: its rows, and the programs that were left out with the reasons."""
    found: dict[str, Any] = {
        "name": group.name, "title": group.title, "unit": group.unit, "threads": group.threads, "rows": [],
        "left_out": [], "goals": [goal._asdict() for goal in group.goals],
    }  # fmt: skip
    if group.threads > (os.cpu_count() or 1):
        return found | {"left_out": [{"name": c.name, "why": "needs a second core"} for c in group.contestants]}
    progress, stages = tell(group.name), len(group.contestants) + count
    start, runners, first = group.start(), list[Runner](), None
    try:
        for k, contestant in enumerate(group.contestants):
            try:
                runner, row, first = prepared(group, contestant, start, first)
            except Missing as missing:
                found["left_out"].append({"name": contestant.name, "why": str(missing)})
            except Exception as error:
                if not runners:  # ours
                    raise
                found["left_out"].append({"name": contestant.name, "why": f"failed: {' '.join(str(error).split())}"})
            else:
                runners.append(runner)
                found["rows"].append(row)
            progress(k + 1, stages)
        speeds = turns(runners, seconds, count, lambda done, of: progress(stages - of + done, stages))
        for k, row in enumerate(found["rows"]):
            row["skin"] = runners[k].skin  # some programs tell it only after a run
            row["speeds"], row["speed"] = speeds[:, k].tolist(), float(np.median(speeds[:, k]))
            row["ratio"] = ratio_of(speeds[:, 0], speeds[:, k])._asdict()
    finally:
        for runner in runners:
            runner.close()
    return found


def prepared(
    group: Group, contestant: Contestant, start: Any, first: np.ndarray | None
) -> tuple[Runner, dict[str, Any], np.ndarray | None]:
    """Return a contestant ready for its turns, its row so far (name and errors), and positions after some fixed
    steps. These must agree with ``first``, the positions of the first contestant."""
    horizon, starts = min(group.horizon, contestant.horizon), min(group.starts, contestant.starts)
    if contestant.alone:
        runner = contestant.make(start)
        row = dict.fromkeys(("energy_error", "energy_error_at_end", "position_error"))
        return runner, row | named(contestant, runner) | {"horizon": 0.0, "starts": 1}, first
    errors, off = [], None
    for seed in reversed(range(starts)):
        begin = start.moved(seed) if starts > 1 else start
        runner = contestant.make(begin)
        energy = begin.energy(begin.positions, begin.velocities)
        looks = runner.looks(horizon, group.looks)
        errors.append([float((begin.energy(*phase) - energy) / abs(energy)) for phase in looks])
    if group.unit == "steps":
        first = agreed(contestant.make(start), start, first, group.agree)
    elif start.reference and horizon >= start.reference[0]:
        off = start.apart(contestant.make(start).at(start.reference[0])[0], start.reference[1])
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    row = named(contestant, runner) | {
        "energy_error": float(np.sqrt(np.mean(rms**2))), "energy_error_at_end": float(rms[-1]), "horizon": horizon,
        "starts": starts, "position_error": off,
    }  # fmt: skip
    return runner, row, first


def named(contestant: Contestant, runner: Runner) -> dict[str, Any]:
    """Name, version, precision and skin of a runner."""
    about = {"version": runner.version, "precision": runner.precision, "skin": runner.skin}
    return {"name": contestant.name, **about}


def agreed(runner: Runner, start: Any, first: np.ndarray | None, within: float) -> np.ndarray:
    """Positions after some steps. Raises RuntimeError if they differ from ``first``."""
    runner.run(AGREE_STEPS)
    x = runner.phase()[0]
    runner.close()
    if first is not None:
        apart = start.apart(x, first)
        if not apart <= (within if runner.precision == "float64" else AGREE_SINGLE):
            raise RuntimeError(f"it does something else: positions are {apart:.1e} apart after {AGREE_STEPS} steps")
        return first
    return x


def timed(command: Command, count: int) -> dict[str, Any]:
    """Time a command in its own process. A first run, which may compile, does not count."""
    words = [sys.executable, "-c", "from kickdrift.cli.main import main; main()", *command.words]
    folder = str(Path(kickdrift.__file__).parents[1])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")])}
    times = []
    for _ in range(count + 1):
        began = perf_counter()
        done = subprocess.run(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        times.append(perf_counter() - began)
        if done.returncode:
            raise RunError(f"{command.title} failed: {(done.stderr.strip().splitlines() or ['no word'])[-1]}")
    return {
        "name": command.name, "title": command.title, "unit": "seconds", "at_most": command.at_most,
        "times": times[1:], "median": float(np.median(times[1:])),
    }  # fmt: skip


def claims_of(found: dict[str, Any]) -> list[Claim]:
    claims = []
    for group in found["groups"]:
        if "times" in group:
            text, bound = f"{group['name']}: seconds of {group['title']}", f"at most {group['at_most']:g}"
            claims.append(claim(text, group["median"], bound, group["median"] <= group["at_most"], "a clock"))
            continue
        for goal in (Goal(**each) for each in group["goals"]):
            claims += judged(group, goal)
    return claims


def judged(group: dict[str, Any], goal: Goal) -> list[Claim]:
    """Claims of one goal: the speed, and the error if the goal has one."""
    text = f"{group['name']}: {goal.ours} over {goal.against}"
    bound = f"at least {goal.at_least:g}"
    rows = {row["name"]: row for row in group["rows"]}
    theirs = [rows[goal.against]] if goal.against in rows else []
    theirs = theirs or [row for name, row in rows.items() if name.startswith(goal.against)]
    if not theirs or goal.ours not in rows:
        absent = [each["why"] for each in group["left_out"] if each["name"].startswith((goal.against, goal.ours))]
        return [not_run(text, bound, goal.against, absent[0] if absent else "")]
    ours, other = rows[goal.ours], max(theirs, key=lambda row: row["speed"])
    ratio = float(np.median(np.array(ours["speeds"]) / np.array(other["speeds"])))
    found = [claim(text, ratio, bound, ratio >= goal.at_least, f"{other['name']} {other['version']}")]
    if goal.error:
        text = f"{group['name']}: energy error of {goal.ours} over {goal.against}'s"
        found.append(at_most(text, ours["energy_error"] / other["energy_error"], MOST, other["name"]))
    return found


def claims() -> list[Claim]:
    return claims_of(measure(chosen()))


def table(group: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Columns and rows of a group, as text."""
    if "times" in group:
        low, high = min(group["times"]), max(group["times"])
        return ["seconds", "spread"], [[f"{group['median']:.2f}", f"{low:.2f} to {high:.2f}"]]
    unit = group["unit"]
    columns = ["program", f"{unit}/s", "kickdrift over it", "energy error", "over", "precision", "skin", "version"]
    placed = any(row["position_error"] is not None for row in group["rows"])
    if placed:
        columns.insert(5, "position error")
    rows = []
    for row in group["rows"]:
        ratio = row["ratio"]
        spread = f"{ratio['median']:.3g} ({ratio['low']:.3g} to {ratio['high']:.3g})"
        cells = [
            row["name"], f"{row['speed']:.4g}", spread if row is not group["rows"][0] else "1",
            *_error_cells(row, unit), row["precision"], row["skin"] or "–",
            row["version"],
        ]  # fmt: skip
        if placed:
            cells.insert(5, "–" if row["position_error"] is None else f"{row['position_error']:.1e}")
        rows.append(cells)
    return columns, rows


def _error_cells(row: dict[str, Any], unit: str) -> tuple[str, str]:
    error = row["energy_error"]
    return ("–", "–") if error is None else (f"{error:.1e}", f"{row['horizon']:g} {unit}")


def goals_table(found: dict[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Columns and rows of all claims, as text."""
    met = {"pass": "met", "fail": "missed", "not run": "not run"}
    columns = ["claim", "measured", "bound", "", "beside"]
    return columns, [
        [str(row["claim"]), text_of(row["value"]), str(row["bound"]), met[str(row["verdict"])], str(row["reference"])]
        for row in claims_of(found)
    ]


def print_found(found: dict[str, Any]) -> None:
    """Print all tables on standard output."""
    from kickdrift.cli.console import out, print_table

    for group in found["groups"]:
        columns, rows = table(group)
        if rows:
            print_table(f"{group['name']}: {group['title']}", columns, rows)
    print_table("claims", *goals_table(found))
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    out(
        f"{found['processor']}, {found['cores']} cores, {found['simd']}; {versions}; {found['turns']} turns of "
        f"{found['seconds']:g} s; load before {found['load_before'] or 0:.1f}"
    )


def left_out(found: dict[str, Any]) -> list[str]:
    """A line for each program that took no part, and how to change that."""
    lines = [f"{each['name']}: {each['why']}" for group in found["groups"] for each in group.get("left_out", ())]
    return list(dict.fromkeys(lines))


def main() -> int:
    """Measure with the given options and print the claims. The exit status is 1 where a claim is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", action="append", default=[], metavar="GROUP", help="repeat for several")
    parser.add_argument("--turns", type=int, default=TURNS, help="of each")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of a turn")
    given = parser.parse_args()
    found = measure(chosen(given.only), given.turns, given.seconds)
    print_found(found)
    for line in left_out(found):
        print(line, file=sys.stderr)
    return show(claims_of(found))


if __name__ == "__main__":
    sys.exit(main())
