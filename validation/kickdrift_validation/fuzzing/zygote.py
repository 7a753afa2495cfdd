"""A process that has loaded kickdrift and forks workers, which fork a child for every command.

Cases come as pickles through a socket, each a generator, a number and a seed; the answer goes back as JSON. Workers run
nothing of a case themselves.
"""

import atexit
import gc
import json
import os
import pickle
import resource
import shutil
import signal
import socket
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from kickdrift_validation.fuzzing import places
from kickdrift_validation.fuzzing.case import Case
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
    "kickdrift.cli.ensemble",
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


WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
TOUCHES = {
    "os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.chown",
}  # fmt: skip
STARTS = {"os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "os.spawn", "pty.spawn", "socket.connect"}


def fence(allowed: tuple[str, ...], program: str) -> Callable[[str, tuple[Any, ...]], None]:
    """An audit hook that notes in the file control/notes what Python code touches outside the allowed folders."""
    notes = os.open("../control/notes", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    beginnings = tuple(os.path.realpath(each) for each in allowed)

    def inside(path: Any) -> bool:
        if isinstance(path, (str, bytes, os.PathLike)) and "__pycache__" in os.fsdecode(path):
            return True
        if isinstance(path, int):
            return True
        real = os.path.realpath(os.fsdecode(path))
        return real.startswith(beginnings) or real.startswith(("/dev/", "/proc/self/fd"))

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        text = ""
        if event == "open":
            path, _, flags = arguments
            if isinstance(flags, int) and flags & WRITES and not inside(path):
                text = f"opens {os.fsdecode(path)} to write"
        elif event in TOUCHES:
            outside = [
                each for each in arguments[:2] if isinstance(each, (str, bytes, os.PathLike)) and not inside(each)
            ]
            if outside and event not in ("os.symlink",):
                text = f"{event} {os.fsdecode(outside[0])}"
        elif event in STARTS and program not in str(arguments) and "('127.0.0.1'," not in str(arguments):
            text = f"{event} {arguments!r:.200}"
        if text:
            os.write(notes, (text.replace("\n", " ") + "\n").encode("utf-8", "replace"))

    return hook


def child(command: tuple[str, ...], home: Path, tolerated: tuple[str, ...]) -> None:
    """Run one command as the program would, and end the process."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for fd, name, flags in ((1, "out", os.O_WRONLY), (2, "err", os.O_WRONLY)):
        os.dup2(os.open(home / "control" / name, flags | os.O_CREAT | os.O_TRUNC | os.O_APPEND), fd)
    os.chdir(home / "work")
    tempfile.tempdir = str(home / "tmp")
    sys.addaudithook(fence((str(home / "work"), str(home / "tmp"), str(home / "control"), *tolerated), sys.executable))
    status: Any = 0
    try:
        if command[0].startswith("!"):
            module, _, name = command[0][1:].rpartition(".")
            status = getattr(import_module(f"kickdrift_validation.fuzzing.{module or 'actions'}"), name)(*command[1:])
        else:
            from kickdrift.cli import main as cli

            sys.argv = ["kickdrift", *command]
            cli.main()
    except SystemExit as error:
        status = error.code
    except BaseException:
        traceback.print_exc()
        status = 1
    with suppress(BaseException):
        atexit._run_exitfuncs()
    with suppress(BaseException):
        sys.stdout.flush()
    with suppress(BaseException):
        sys.stderr.flush()
    os._exit(status if isinstance(status, int) else int(status is not None))


if __name__ == "__main__":
    main()
