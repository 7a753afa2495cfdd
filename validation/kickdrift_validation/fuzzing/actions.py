"""What a case does beside commands, in a child of the zygote: read a file, and compare it with the truth.

Each returns an exit status: 0, or 2 where a file was refused by an InputError.
"""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kickdrift_validation.fuzzing.places import ENSEMBLE, JOURNAL

FRAMES, LOST, NO_FILE = "a silent wrong frame", "a bit lost", "no file yet"
WRONG = "a silent wrong table"


def truth(name: str) -> Path:
    """The undamaged file of the whole run."""
    return Path(os.environ["KICKDRIFT_FUZZ_BASE"]) / name


def content(path: Path) -> dict[str, Any]:
    """The frames of a run file, and all that gives their numbers a meaning."""
    import kickdrift as kd

    with kd.open(path) as run:
        frames = [(f.step, f.time, f.positions.tobytes(), f.velocities.tobytes()) for f in run]
        return {
            "frames": frames, "units": run.units.name, "box": run.box.lengths, "ids": run.ids.tolist(),
            "masses": run.masses.tolist(), "species": [run.species[k] for k in run.species_index],
        }  # fmt: skip


def tried(act: Callable[[], Any]) -> Any:
    """What a function returns; where kickdrift refuses its input, an exit status, after one line."""
    from kickdrift.errors import KickdriftError

    try:
        return act()
    except KickdriftError as error:
        print(f"kickdrift: {error}", file=sys.stderr)
        return error.exit_status


def found_in(name: str) -> dict[str, Any] | int:
    """The content of a file; where it is refused, an exit status."""
    found: dict[str, Any] | int = tried(lambda: content(Path(name)))
    return found


def set_up(hosts: str, processes: str) -> int:
    """Make a Simulation whose processes are on the machines of a hosts file, all of them this one."""
    import kickdrift as kd
    from kickdrift.engines import hosts as machines
    from kickdrift.model.checks.limits import PROCESS_BYTES, check_room

    machines._ends = lambda name: ("127.0.0.1", "127.0.0.1")  # asks no name server

    def act() -> int:
        count = int(processes) if processes else None
        sim = kd.Simulation(kd.load("lj.toml"), engine="lammps", hosts=hosts, processes=count)
        check_room("run", sim.processes, "processes", PROCESS_BYTES)
        print(f"{sim.processes} processes")
        return 0

    return int(tried(act))


def load(table: Any) -> int:
    """Make the System or Problem of a dict."""
    import kickdrift as kd

    found = tried(lambda: kd.load(table))
    return found if isinstance(found, int) else 0


def open(name: str) -> int:
    """Read every frame, right or wrong."""
    found = found_in(name)
    return found if isinstance(found, int) else 0


def read(name: str, whole: str, before: str) -> int:
    """Read every frame: those of the whole run, as many as the file had before it was damaged, or one line."""
    found = found_in(name)
    if isinstance(found, int):
        return found
    expected = content(truth(whole))
    for key, value in expected.items():
        if found[key] != (value[: len(found[key])] if key == "frames" else value):
            raise AssertionError(f"{FRAMES}: other {key}")
    if len(found["frames"]) < len(content(truth(before))["frames"]):
        raise AssertionError(f"{FRAMES}: some are not there")
    print(f"{len(found['frames'])} of {len(expected['frames'])} frames")
    return 0


def table(name: str) -> int:
    """Read the table of an ensemble: the one that was written, or one line."""
    import kickdrift as kd

    expected = kd.Ensemble.read(truth(name))
    try:
        found = kd.Ensemble.read(name)
    except kd.InputError as error:
        print(f"kickdrift: {error}", file=sys.stderr)
        return error.exit_status
    if repr(found.to_dict()) != repr(expected.to_dict()) or found.attrs != expected.attrs:
        raise AssertionError(WRONG)
    print(f"{len(found)} members")
    return 0


def command(*words: str) -> int:
    """Run a command of the program; its exit status."""
    from kickdrift.cli import main as cli

    sys.argv = ["kickdrift", *words]
    try:
        cli.main()
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else 1
    return 0


def goes_on(name: str, whole: str) -> int:
    """After a kill: the file opens, its frames are the first of the whole run's, and a resume ends in the same bits."""
    import kickdrift as kd
    from kickdrift_validation import kills

    if not Path(name).exists():
        print(NO_FILE)
        return 0
    with kd.open(truth(whole)) as reference:
        print(f"{kills.same_beginning(Path(name), reference)} of {len(reference)} frames")
    if status := command("resume", name, "--quiet"):
        raise AssertionError(f"{LOST}: resume ends with {status}")
    if kills.content(Path(name)) != kills.content(truth(whole)):
        raise AssertionError(f"{LOST}: resume ends in other bits")
    return 0


def ensemble_goes_on() -> int:
    """After a kill: the same command ends in the table of an ensemble that was left alone."""
    import kickdrift as kd

    if not Path(JOURNAL).exists():
        print(NO_FILE)
    if status := command(*ENSEMBLE):
        raise AssertionError(f"{LOST}: the ensemble ends with {status}")
    found = kd.Ensemble.read("t.parquet")
    os.remove("t.parquet")
    if command(*ENSEMBLE):
        raise AssertionError("the ensemble does not run again")
    alone = kd.Ensemble.read("t.parquet")
    columns = [column for column in alone.columns if column != "wall_seconds"]
    if not found[columns].equals(alone[columns]):
        raise AssertionError(f"{LOST}: the ensemble ends in another table")
    return 0
