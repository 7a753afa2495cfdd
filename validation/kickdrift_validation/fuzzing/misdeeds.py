"""What a program must not do, done on purpose: so that a test sees whether the zygote notices."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kickdrift_validation.fuzzing.case import Case


def spin() -> None:
    while True:
        pass


def grow() -> None:
    kept = []
    while True:
        kept.append(bytearray(b"x" * 10_000_000))


def said(text: str, status: int = 2) -> int:
    """Print the text on standard error; the exit status."""
    print(text, file=sys.stderr)
    return status


# Each deed, and what the zygote must say of it, and nothing else.
DEEDS: dict[str, tuple[Callable[[], Any], str]] = {
    "nothing": (lambda: 0, ""),
    "hang": (lambda: time.sleep(600), "hangs: no work"),
    "spin": (spin, "hangs: more than"),
    "grow": (grow, "of memory"),
    "crash": (lambda: os.kill(os.getpid(), signal.SIGSEGV), "signal 11"),
    "fail": (lambda: int("no number"), "traceback: ValueError"),
    "two lines": (lambda: said("kickdrift: one\nkickdrift: two"), "2 lines of error"),
    "no line": (lambda: 2, "without a line of error"),
    "escape": (lambda: said("kickdrift: \x1b[31mred"), "control character"),
    "long line": (lambda: said("kickdrift: " + "a" * 5000), "line longer than"),
    "warn": (lambda: said("x.py:1: RuntimeWarning: overflow", 0), "warning: x.py"),
    "other status": (lambda: 7, "exit status 7"),
    "write outside": (lambda: Path("../outside/new").write_text("x") and 0, "touched: opens"),
    "change input": (lambda: Path("input.txt").write_text("other") and 0, "changes a file"),
    "call a shell": (lambda: subprocess.run(["true"], check=True) and 0, "touched: subprocess.Popen"),
    "read outside": (lambda: print(Path("../outside/secret.txt").read_text()), "prints what another file holds"),
}


def do(name: str) -> int:
    """Do it; an exit status."""
    return DEEDS[name][0]() or 0


def case(number: int, seed: int = 0) -> Case:
    """The case that does one of them."""
    name = list(DEEDS)[number]
    return Case("misdeeds", number, (("!misdeeds.do", name),), name, {"input.txt": b"mine"})
