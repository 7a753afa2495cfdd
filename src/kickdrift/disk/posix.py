"""What Python has on POSIX systems alone, and what kickdrift does elsewhere.

No other module imports such modules, but `bridges.rebound_snapshot`, which runs without kickdrift."""

import contextlib
import os
import signal
import threading

try:
    import fcntl
    import resource
    import termios
except ImportError:  # on Windows
    fcntl = resource = termios = None  # type: ignore[assignment]


def lock(number: int) -> None:
    """Lock an open file against other processes, without waiting; elsewhere do nothing.

    Raises BlockingIOError if another process has the lock, and OSError where the file system has no locks."""
    if fcntl is not None:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)


def unsent(number: int) -> bool:
    """Whether bytes of a socket are on their way; False where the machine cannot tell."""
    if fcntl is None:
        return False
    return fcntl.ioctl(number, termios.TIOCOUTQ, bytes(4)) != bytes(4)


def memory_limits() -> list[int]:
    """Limits of this process's memory in bytes, such as that of ``ulimit -v``."""
    if resource is None:
        return []
    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    return [limit for limit in limits if limit != resource.RLIM_INFINITY and limit > 0]


def limit_processor_time(seconds: int) -> None:
    """Limit this process's processor time, where the system can."""
    if resource is not None:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))


def interrupt() -> None:
    """Raise Ctrl-C in the main thread, from another thread."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)  # type: ignore[arg-type]
    else:
        signal.raise_signal(signal.SIGINT)


def flags(*names: str) -> int:
    """The flags of `os.open` of these names, such as O_CLOEXEC, that this system has."""
    found = 0
    for name in names:
        found |= getattr(os, name, 0)
    return found
