"""A process that has loaded kickdrift and forks workers, which fork a child for every command.

Cases come as pickles through a socket, each a generator, a number and a seed; the answer goes back as JSON. Workers run
nothing of a case themselves.
"""

import gc
import json
import os
import pickle
import resource
import shutil
import socket
import sys
import warnings
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from kickdrift_validation.fuzzing import places
from kickdrift_validation.fuzzing.case import Case
from kickdrift_validation.fuzzing.child import child
from kickdrift_validation.fuzzing.flags import FLAGS, listen_to_compiler, mark_work
from kickdrift_validation.fuzzing.rules import Ended, broken
from kickdrift_validation.fuzzing.watch import Limits, watch

READY = "ready"
NOTHING = {"seconds": 0.0, "megabytes": 0.0}
WARM = (
    "kickdrift.ensemble",
    "kickdrift.plots.runs",
    "kickdrift.plots.orbits",
    "kickdrift.trajectory.export.export",
    "kickdrift.trajectory.read.info",
    "kickdrift.cli.printing_ensemble",
)


def run(command: tuple[str, ...], home: Path, limits: Limits, tolerated: tuple[str, ...], may_compute: bool = False,
        kill_after: float | None = None) -> Ended:  # fmt: skip
    """Fork a child that runs the command; what came of it."""
    for name in ("notes", "out", "err"):
        (home / "control" / name).write_bytes(b"")
    FLAGS.clear()
    pid = os.fork()
    if not pid:
        child(command, home, tolerated)
    ended = Ended(command, 0, "", "")
    watch(pid, limits, may_compute, kill_after, ended)
    read = {
        name: (home / "control" / name).read_bytes()[:200_000].decode("utf-8", "replace") for name in ("out", "err")
    }
    ended.out, ended.err = read["out"], read["err"]
    ended.notes = sorted(set((home / "control" / "notes").read_text(encoding="utf-8", errors="replace").splitlines()))
    if places.MARK in ended.out + ended.err or f"{places.MARK_NUMBER:.4g}" in ended.out:
        ended.notes.append("prints what another file holds")
    return ended


def tried(case: Case, home: Path, base: Path, limits: Limits, tolerated: tuple[str, ...]) -> dict[str, Any]:
    """Run a case's commands in a fresh folder; what they broke."""
    for name in ("work", "tmp"):
        shutil.rmtree(home / name, ignore_errors=True)
    (home / "control").mkdir(exist_ok=True)
    (home / "work").mkdir(parents=True)
    (home / "tmp").mkdir()
    if not (home / "outside").is_dir():
        places.make_outside(home / "outside")
    if case.places:
        places.furnish(home / "work", base)
    for name, data in case.files.items():
        (home / "work" / name).write_bytes(data)
    found, ends = list[str](), list[Ended]()
    outside = places.touched(home / "outside")
    for number, command in enumerate(case.commands):
        before = places.prints(home / "work")
        ended = run(command, home, limits, tolerated, case.may_compute, None if number else case.kill_after)
        ends.append(ended)
        found += broken(ended, case.statuses, case.may_compute)
        changed, new = places.changes(before, places.prints(home / "work"))
        found += [f"changes a file that it should not: {name!a}" for name in sorted(changed - case.may_change)]
        if ended.status == 2 and not ended.stopped and not command[0].startswith("!"):
            found += [f"leaves {name!a} behind with exit status 2" for name in sorted(new)]
    if places.touched(home / "outside") != outside:
        found.append("touched: a file outside its folder")
        shutil.rmtree(home / "outside", ignore_errors=True)
    shown = [[list(each.command), each.status, each.stopped, each.err[-3000:], each.out[-300:]] for each in ends]
    seconds, memory = max(each.seconds for each in ends), max(each.megabytes for each in ends)
    return {"kind": case.kind, "number": case.number, "about": case.about, "found": list(dict.fromkeys(found)),
            "ends": shown, "seconds": seconds, "megabytes": memory}  # fmt: skip


def warm(base: Path) -> None:
    """Make the run files, and run a few commands, so that children find modules and compiled code loaded."""
    from kickdrift.cli import main as cli

    for name in ("matplotlib.pyplot", *WARM):
        with suppress(ImportError):
            import_module(name)
    places.make_bases(base)
    for command in ("run two-body --steps 2 --quiet", "run ode-harmonic --steps 2 --quiet"):
        sys.argv = ["kickdrift", *command.split()]
        with suppress(SystemExit):
            cli.main()


def serve(line: socket.socket, home: Path, base: Path, limits: Limits, tolerated: tuple[str, ...]) -> None:
    """Try the cases that come, until no more do."""
    home.mkdir()
    FLAGS.renew()
    with line, line.makefile("rwb") as file:

        def say(answer: Any) -> None:
            file.write(json.dumps(answer).encode() + b"\n")
            file.flush()

        say(READY)
        while True:
            try:
                make, number, seed = pickle.load(file)
            except EOFError:
                return
            try:
                result = tried(make(number, seed), home, base, limits, tolerated)
            except Exception as error:  # of the worker itself, which goes on with the next case
                found = [f"the worker failed: {type(error).__name__}: {error}"]
                result = {"number": number, "about": make.__module__, "found": found, "ends": []} | NOTHING
            say(result)


def main() -> None:
    scratch, settings = Path(sys.argv[1]), json.loads(sys.argv[2])
    base, limits = scratch / "base", Limits(**settings["limits"])
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.filterwarnings("ignore", message=r".*fork\(\)")  # Python 3.12 warns where a library has a thread
    os.environ["KICKDRIFT_FUZZ_BASE"] = str(base)
    tolerated: tuple[str, ...] = ()
    if settings["warm"]:
        from kickdrift.jit.cache.folders import folder as cache_folder

        tolerated = (str(cache_folder()),)
        listen_to_compiler()
        mark_work()
        warm(base)
    gc.freeze()
    lines = [socket.socket(fileno=fd) for fd in settings["fds"]]
    workers = []
    for k, line in enumerate(lines):
        if pid := os.fork():
            workers.append(pid)
            continue
        for other in lines:
            if other is not line:
                other.close()
        serve(line, scratch / f"worker-{k}", base, limits, tolerated)
        os._exit(0)
    for line in lines:
        line.close()
    for pid in workers:
        os.waitpid(pid, 0)


if __name__ == "__main__":
    main()
