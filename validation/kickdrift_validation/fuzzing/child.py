"""The child of a worker: one command, run as the program runs it, and an eye on what it touches."""

import atexit
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
TOUCHES = {
    "os.remove",
    "os.rename",
    "os.mkdir",
    "os.rmdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
    "os.chown",
}
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
