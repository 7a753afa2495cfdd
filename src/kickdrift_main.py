"""The command ``kickdrift``, outside the package so that Ctrl-C works during the package's import."""

from __future__ import annotations

import os
import signal
from types import FrameType

INTERRUPTED = 130


def main() -> None:
    """Import the program and run it; Ctrl-C ends it with exit status 130 at any time."""
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # false in a shell's background
    if heard:
        signal.signal(signal.SIGINT, _end)
    from kickdrift.cli.main import main as program

    if heard:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        program()
    finally:
        if heard:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # only Python's own shutdown is left


def _end(number: int, frame: FrameType | None) -> None:
    """End at once: nothing has started."""
    try:
        os.write(2, b"kickdrift: interrupted\n")
    finally:
        os._exit(INTERRUPTED)
