"""Ctrl-C at safe moments."""

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from kickdrift.disk.posix import interrupt

AGAIN = 0.01  # seconds until a lost interrupt is raised again
KILLED = 128  # exit status of a program that a signal ends, less the signal's number


@contextmanager
def heard_everywhere() -> Iterator[Callable[[], bool]]:
    """Lose no Ctrl-C. A callback of compiled code cannot raise, so an interrupt there is raised again later. Other
    libraries turn an interrupt into errors of their own: the yielded function tells whether there was one."""
    before, pressed = sys.unraisablehook, threading.Event()

    def again(found: Any) -> None:
        if issubclass(found.exc_type, KeyboardInterrupt):
            timer = threading.Timer(AGAIN, interrupt)
            timer.daemon = True
            timer.start()
        else:
            before(found)

    def note(signum: int, frame: Any) -> None:
        pressed.set()
        raise KeyboardInterrupt

    ours = threading.current_thread() is threading.main_thread()
    ours = ours and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    sys.unraisablehook = again
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        sys.unraisablehook = before


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C only set a flag, which the yielded function reads. A second Ctrl-C interrupts at once."""
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set
        return

    def note(signum: int, frame: Any) -> None:
        if pressed.is_set():
            raise KeyboardInterrupt
        pressed.set()

    before = signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def tidy() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end the program by SystemExit, so that what this context began is removed. A program that
    has handlers of its own keeps them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(signum: int, frame: Any) -> None:
        raise SystemExit(KILLED + signum)

    numbers = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    ours = [each for each in numbers if signal.getsignal(each) == signal.SIG_DFL]
    for each in ours:
        signal.signal(each, end)
    try:
        yield
    finally:
        for each in ours:
            signal.signal(each, signal.SIG_DFL)


@contextmanager
def whole() -> Iterator[None]:
    """Delay Ctrl-C until the end; a second one interrupts at once. Processes and threads that begin inside never get
    Ctrl-C, which a terminal sends to every process."""
    with interruptible() as pressed:
        try:
            with _deaf():
                yield
        finally:  # a Ctrl-C pressed meanwhile arrives when the block ends
            if pressed():
                raise KeyboardInterrupt


@contextmanager
def _deaf() -> Iterator[None]:
    """Block Ctrl-C in this thread and in everything that it starts. The main thread's handler still runs."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
