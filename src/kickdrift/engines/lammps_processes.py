"""LAMMPS in several processes: mpiexec starts them, each runs ``lammps_worker``, and all get the same commands.

The processes connect to a socket in a folder that only this user can enter, or over the network if some run on other
machines (see ``hosts``). They run in a session of their own, so that Ctrl-C reaches only this process, which then
ends them. They also end when this process ends (see ``keeper``).
"""

import contextlib
import math
import os
import re
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Mapping
from functools import partial
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic
from typing import Any

from kickdrift.engines import keeper
from kickdrift.engines.hosts import KEY_BYTES, accepted, address_towards, listening
from kickdrift.forces.external.lammps_library import mpiexec

SOCKET = "KICKDRIFT_LAMMPS_SOCKET"  # name of the variable with the socket's address
KEY = "KICKDRIFT_LAMMPS_KEY"  # name of the variable with the key, for connections over the network
KEPT = ("HYDRA_LAUNCHER", "HYDRA_LAUNCHER_EXEC")  # mpiexec's variables that a user sets to reach other machines
START_SECONDS = 120.0  # limit for the start of all processes
QUIET = ("=", "Warning:")  # beginnings of lines that say nothing: mpiexec's frame, and ssh's notes on known machines
_MPIEXEC = re.compile(r"\[(mpiexec|proxy:\d+)@\S+\] \w+ \([^)]*\): ")  # beginning of a line of mpiexec's own
POLL_SECONDS = 0.5
ORDERS = ("reset", "run", "kinetic_energy", "heat", "images", "state", "measure")  # methods of World
END_SECONDS = 5.0  # for orders to be done


class Processes:
    """The methods of ``lammps_world.World``, on all processes at once. Answers are the first process's."""

    def __init__(self, count: int, hosts: Mapping[str, int] | None = None) -> None:
        self.count, program = count, mpiexec()
        self.folder = folder = Path(tempfile.mkdtemp(prefix="kickdrift-"))
        self._said = (folder / "said").open("w+")
        self._key = secrets.token_bytes(KEY_BYTES) if hosts else None
        try:
            machines, own = ([], "") if hosts is None else _machines(hosts, folder)
            with _door(folder, own, count) as door:
                door.settimeout(POLL_SECONDS)
                words = [str(program), *machines, "-n", str(count)]
                self._process = subprocess.Popen(
                    [sys.executable, "-I", "-S", keeper.__file__, *words, sys.executable, "-m",
                     "kickdrift.engines.lammps_worker"], stdin=subprocess.PIPE, stdout=self._said,
                    stderr=self._said, env=_environment(door, self._key), start_new_session=True,
                )  # fmt: skip
                self._connections: list[Connection] = []
                self.close = weakref.finalize(self, _end, self._process, self._connections, self._said, folder)
                self._begin(door)
        except BaseException:
            if hasattr(self, "close"):
                self.close()
            self._said.close()
            shutil.rmtree(folder, ignore_errors=True)
            raise

    def _begin(self, door: socket.socket) -> None:
        """Wait for all processes, and put their connections in the order of their ranks."""
        until = monotonic() + START_SECONDS
        self._accept(door, until)
        ranks = dict(zip(self._answers(until), self._connections, strict=True))
        self._connections[:] = [ranks[rank] for rank in sorted(ranks)]

    def _accept(self, door: socket.socket, until: float) -> None:
        """Accept a connection from each process."""
        while len(self._connections) < self.count:
            with contextlib.suppress(TimeoutError):
                stream, _ = door.accept()
                if connection := _proven(stream, self._key):
                    self._connections.append(connection)
            if self._process.poll() is not None:
                raise RuntimeError(f"mpiexec ended with status {self._process.returncode}{self._cause()}")
            if monotonic() > until:
                raise self._late(len(self._connections))

    def _late(self, came: int) -> RuntimeError:
        return RuntimeError(f"{came} of {self.count} processes started within {START_SECONDS:g} s")

    def _lines(self) -> list[str]:
        """The output of mpiexec and of all processes."""
        self._said.flush()
        self._said.seek(0)
        return [line.strip() for line in self._said.read().splitlines()]

    def _last_words(self) -> str:
        """The last error in the output."""
        telling = [line for line in self._lines() if "rror" in line]
        return f": {telling[-1]}" if telling else ""

    def _cause(self) -> str:
        """The reason why the processes did not start: a program's last error, else the first line. mpiexec's further
        lines only say that mpiexec ends."""
        lines = [line for line in self._lines() if line and not line.startswith(QUIET)]
        own = [line for line in lines if "rror" in line and not _MPIEXEC.match(line)]
        telling = own[-1:] or lines[:1]
        return f": {_MPIEXEC.sub('', telling[0])}" if telling else ""

    def _all(self, what: str, *arguments: Any) -> Any:
        try:
            for rank, connection in enumerate(self._connections):
                try:
                    connection.send((what, arguments))
                except OSError:
                    raise self._died(rank) from None
            return self._answers()[0]
        except BaseException:
            self.close()
            raise

    def _answers(self, until: float = math.inf) -> list[Any]:
        """Answers of all processes. Raises at the first error or exit, since the others may wait forever. The first
        answer, which comes once MPI is up, has a deadline."""
        answers: dict[int, Any] = {}
        while len(answers) < len(self._connections):
            waiting = {c: rank for rank, c in enumerate(self._connections) if rank not in answers}
            ready = set(wait(list(waiting), POLL_SECONDS))
            for connection, rank in waiting.items():
                if connection not in ready:
                    continue
                try:
                    error, answers[rank] = connection.recv()
                except (EOFError, OSError):
                    raise self._died(rank) from None
                if error:
                    raise RuntimeError(error)
            if len(answers) < len(self._connections) and monotonic() > until:
                raise self._late(len(answers))
        return [answers[rank] for rank in range(len(self._connections))]

    def _died(self, rank: int) -> RuntimeError:
        return RuntimeError(f"process {rank} of {self.count} died{self._last_words()}")

    def __getattr__(self, name: str) -> Any:
        if name not in ORDERS:
            raise AttributeError(name)
        return partial(self._all, name)


def _machines(hosts: Mapping[str, int], folder: Path) -> tuple[list[str], str]:
    """Return mpiexec's options for these machines, and this machine's address as the others see it."""
    own = address_towards(list(hosts))
    plain = folder / "hosts"  # without comments, which mpiexec takes at the start of a line alone
    plain.write_text("".join(f"{name}:{count}\n" for name, count in hosts.items()))
    return ["-f", str(plain), "-localhost", own], own


def _door(folder: Path, address: str, count: int) -> socket.socket:
    """Return the socket that the processes connect to: in the folder, or at an address if one is given."""
    if address:
        return listening(address, count)
    door = socket.socket(socket.AF_UNIX)
    door.bind(str(folder / "socket"))
    door.listen(count)
    return door


def _environment(door: socket.socket, key: bytes | None) -> dict[str, str]:
    """Return the processes' environment, which says where the door is."""
    folders = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PMI_", "HYDRA_")) or k in KEPT}
    where = door.getsockname()
    return kept | {
        SOCKET: where if key is None else f"{where[0]}:{where[1]}",
        KEY: "" if key is None else key.hex(),
        "PYTHONPATH": os.pathsep.join(each for each in folders if each),
        "OMP_NUM_THREADS": "1",
        "PYTHONSAFEPATH": "1",  # no module from the current folder, which may be another user's
    }


def _proven(stream: socket.socket, key: bytes | None) -> Connection | None:
    """Return the connection; None if it comes over the network and does not know the key."""
    if key is not None:
        return accepted(stream, key)
    stream.setblocking(True)
    return Connection(stream.detach())


def _end(process: subprocess.Popen, connections: list[Connection], said: Any, folder: Path) -> None:
    """Ask the processes to end, and kill those that do not."""
    for connection in connections:
        connection.close()  # tells a process to end once its work is done
    assert process.stdin is not None
    for act in (lambda: None, process.stdin.close, lambda: os.killpg(process.pid, signal.SIGKILL)):
        with contextlib.suppress(ProcessLookupError):
            act()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(END_SECONDS + keeper.END_SECONDS)
            break
    process.stdin.close()
    said.close()
    shutil.rmtree(folder, ignore_errors=True)
