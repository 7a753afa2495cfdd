"""LAMMPS in several processes: mpiexec starts them, each runs ``lammps_worker``, and all get the same commands.

The processes connect to a socket in a folder that only this user can enter. They run in a session of their own, so that
Ctrl-C reaches only this process, which then ends them. They also end when this process ends.
"""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import weakref
from multiprocessing.connection import Connection, wait
from pathlib import Path
from time import monotonic
from typing import Any

from kickdrift.engines.lammps_library import mpiexec

SOCKET = "KICKDRIFT_LAMMPS_SOCKET"  # name of the variable with the socket's address
START_SECONDS = 120.0  # limit for the start of all processes
POLL_SECONDS = 0.5
END_SECONDS = 5.0


class Processes:
    """The methods of ``lammps_world.World``, on all processes at once. Answers are the first process's."""

    def __init__(self, count: int) -> None:
        self.count, program = count, mpiexec()
        self.folder = folder = Path(tempfile.mkdtemp(prefix="kickdrift-"))
        self._said = (folder / "said").open("w+")
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(folder / "socket"))
            listening.listen(count)
            listening.settimeout(POLL_SECONDS)
            folders = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
            path = os.pathsep.join(each for each in folders if each)
            environment = {k: v for k, v in os.environ.items() if not k.startswith(("PMI_", "HYDRA_"))}
            environment |= {SOCKET: str(folder / "socket"), "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
            environment["PYTHONSAFEPATH"] = "1"  # no module from the current folder, which may be another user's
            words = [str(program), "-n", str(count), sys.executable, "-m", "kickdrift.engines.lammps_worker"]
            try:
                self._process = subprocess.Popen(
                    words, stdin=subprocess.DEVNULL, stdout=self._said, stderr=self._said, env=environment,
                    start_new_session=True,
                )  # fmt: skip
            except BaseException:
                self._said.close()
                shutil.rmtree(folder, ignore_errors=True)
                raise
            self._connections: list[Connection] = []
            self.close = weakref.finalize(self, _end, self._process, self._connections, self._said, folder)
            try:
                until = monotonic() + START_SECONDS
                self._accept(listening, until)
                ranks = dict(zip(self._answers(until), self._connections, strict=True))
                self._connections[:] = [ranks[rank] for rank in sorted(ranks)]
            except BaseException:
                self.close()
                raise

    def _accept(self, listening: socket.socket, until: float) -> None:
        """Accept a connection from each process."""
        while len(self._connections) < self.count:
            with contextlib.suppress(TimeoutError):
                connection, _ = listening.accept()
                connection.setblocking(True)
                self._connections.append(Connection(connection.detach()))
            if self._process.poll() is not None:
                raise RuntimeError(f"mpiexec ended with status {self._process.returncode}{self._last_words()}")
            if monotonic() > until:
                raise self._late(len(self._connections))

    def _late(self, came: int) -> RuntimeError:
        return RuntimeError(f"{came} of {self.count} processes started within {START_SECONDS:g} s")

    def _last_words(self) -> str:
        """A process's last output."""
        self._said.flush()
        self._said.seek(0)
        lines = [line.strip() for line in self._said.read().splitlines()]
        telling = [line for line in lines if "rror" in line]
        return f": {telling[-1]}" if telling else ""

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

    # --- World's methods ---

    def reset(self, *arguments: Any) -> None:
        """See World."""
        self._all("reset", *arguments)

    def run(self, steps: int) -> None:
        """See World."""
        self._all("run", steps)

    def kinetic_energy(self) -> float:
        """See World."""
        return float(self._all("kinetic_energy"))

    def heat(self) -> float:
        """See World."""
        return float(self._all("heat"))

    def images(self) -> Any:
        """See World."""
        return self._all("images")

    def state(self) -> Any:
        """See World."""
        return self._all("state")

    def measure(self) -> Any:
        """See World."""
        return self._all("measure")


def _end(process: subprocess.Popen, connections: list[Connection], said: Any, folder: Path) -> None:
    """Ask the processes to end, and kill those that do not."""
    for connection in connections:
        connection.close()  # tells a process to end once its work is done
    for act in (lambda: None, process.terminate, lambda: os.killpg(process.pid, signal.SIGKILL)):
        with contextlib.suppress(ProcessLookupError):
            act()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(END_SECONDS)
            break
    said.close()
    shutil.rmtree(folder, ignore_errors=True)
