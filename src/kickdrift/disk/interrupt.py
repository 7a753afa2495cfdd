"""Ctrl-C that waits for a good moment."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

AGAIN = 0.01  # seconds after which an interrupt that was lost comes again


@contextmanager
def heard_everywhere() -> Iterator[None]:
    """Inside, no Ctrl-C is lost: one that falls into a callback of compiled code, which cannot raise, comes again."""
    before = sys.unraisablehook

    def again(found: Any) -> None:
        if issubclass(found.exc_type, KeyboardInterrupt):
            timer = threading.Timer(AGAIN, signal.pthread_kill, (threading.main_thread().ident, signal.SIGINT))
            timer.daemon = True
            timer.start()
        else:
            before(found)

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Inside, Ctrl-C only sets a flag, which the function yielded reads; a second one interrupts at once."""
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
def whole() -> Iterator[None]:
    """Inside, Ctrl-C waits for the end; a second one interrupts at once. Processes and threads that begin inside never
    hear Ctrl-C, which a terminal sends to every process."""
    with interruptible() as pressed:
        try:
            with _deaf():
                yield
        finally:  # at the end of deafness comes what was pressed meanwhile
            if pressed():
                raise KeyboardInterrupt


@contextmanager
def _deaf() -> Iterator[None]:
    """Inside, this thread and what it begins do not hear Ctrl-C; the main thread's handler is called all the same."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
