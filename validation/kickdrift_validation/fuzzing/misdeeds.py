"""What a program must not do, done on purpose: so that a test sees whether the zygote notices."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from kickdrift_validation.fuzzing.case import Case


def nothing() -> int:
    return 0


def hang() -> int:
    time.sleep(600)
    return 0


def spin() -> int:
    while True:
        pass


def grow() -> int:
    kept = []
    while True:
        kept.append(bytearray(b"x" * 10_000_000))


def crash() -> int:
    os.kill(os.getpid(), signal.SIGSEGV)
    return 0


def fail() -> int:
    raise ValueError("no such thing")


def two_lines() -> int:
    print("kickdrift: one\nkickdrift: two", file=sys.stderr)
    return 2


def no_line() -> int:
    return 2


def escape() -> int:
    print("kickdrift: \x1b[31mred", file=sys.stderr)
    return 2


def long_line() -> int:
    print("kickdrift: " + "a" * 5000, file=sys.stderr)
    return 2


def warn() -> int:
    print("x.py:1: RuntimeWarning: overflow", file=sys.stderr)
    return 0


def other_status() -> int:
    return 7


def write_outside() -> int:
    Path("../outside/new").write_text("x")
    return 0


def change_input() -> int:
    Path("input.txt").write_text("other")
    return 0


def call_a_shell() -> int:
    subprocess.run(["true"], check=True)
    return 0


def read_outside() -> int:
    print(Path("../outside/secret.txt").read_text())
    return 0


# What the zygote must say of each, and nothing else.
SAID = {
    nothing: "",
    hang: "hangs: no work",
    spin: "hangs: more than",
    grow: "of memory",
    crash: "signal 11",
    fail: "traceback: ValueError",
    two_lines: "2 lines of error",
    no_line: "without a line of error",
    escape: "control character",
    long_line: "line longer than",
    warn: "warning: x.py",
    other_status: "exit status 7",
    write_outside: "touched: opens",
    change_input: "changes a file",
    call_a_shell: "touched: subprocess.Popen",
    read_outside: "prints what another file holds",
}


def case(number: int, seed: int = 0) -> Case:
    """The case that does one of them."""
    name = list(SAID)[number].__name__
    return Case("misdeeds", number, ((f"!misdeeds.{name}",),), name, {"input.txt": b"mine"})
