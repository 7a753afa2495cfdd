"""The watcher that streams a run by IMD, the protocol for interactive molecular dynamics, to one client at a time."""

from __future__ import annotations

import socket
from select import select
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.record import OBSERVING
from kickdrift.model.checks import whole_number
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.forces import forces_at
from kickdrift.run.watch.imd_packets import FORCE_BYTES, HEAD_BYTES, Frame, Kind, Units, greeting, packets, read_head
from kickdrift.run.watch.watcher import Watcher
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration
    from kickdrift.run.report import Report

HOST = "127.0.0.1"
PORT = 8888  # as in GROMACS
POLL = 0.1  # seconds between two checks for Ctrl-C while the run waits
LINGER = 5.0  # seconds at most in which the last frames may reach the client
PORTS = 65535
KILLED = "by the IMD client"
PUSHED = "the IMD client sent forces, which kickdrift does not apply"


def listening(port: int, option: str = "imd") -> socket.socket:
    """A socket that listens to this machine alone. Raises InputError for a wrong port or a taken one."""
    number = whole_number(option, port, 1)
    if number > PORTS:
        raise InputError(f"{option}: a port is a whole number from 1 to {PORTS}, got {shown(port)}")
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((HOST, number))
        found.listen(1)
    except OSError as error:
        found.close()
        raise InputError(f"{option}: port {number} of {HOST}: {error.strerror}; give another port") from None
    return found


class Imd(Watcher):
    """Sends each look as a frame, and obeys the client: pause, resume, kill, rate of frames, disconnect.

    Parameters
    ----------
    run : the Integration to stream
    port : where to listen, on this machine alone
    wait : whether the run waits while no client is there
    """

    part = OBSERVING

    def __init__(self, run: Integration, port: int, wait: bool) -> None:
        system = run.system
        if not isinstance(system, System):
            raise InputError("imd: a Problem has no particles to stream")
        if not isinstance(wait, bool):
            raise InputError(f"imd_wait: expected True or False, got {shown(wait)}")
        self._run, self._wait, self._units = run, wait, Units.of(system.units)
        self._ids, self._boxed = system.state.ids.copy(), all(system.box.periodic_axes)
        self._client: socket.socket | None = None
        self._ready = self._paused = False  # whether the client has said go; whether it has said pause
        self._apart = 1  # least number of steps between frames, as the client asks
        self._last: int | None = None  # step of the last frame
        self._server = listening(port)

    def begin(self) -> None:
        """Wait for a client, if asked."""
        self._server.setblocking(False)
        self._attend()

    def look(self) -> None:
        """Send the look to the client that listens."""
        self._attend()
        step = self._run.steps_done
        due = self._last is None or abs(step - self._last) >= self._apart
        if self._ready and due and not self._run.ended:
            self._send(packets(self._frame(), self._units))
            self._last = step

    def pause(self) -> None:
        """Obey the client between two looks."""
        self._attend()

    def close(self, report: Report | None) -> None:
        """Let the last frames reach the client, and close the sockets."""
        self._server.close()
        if self._client is not None:
            client, until = self._client, monotonic() + LINGER
            try:
                client.shutdown(socket.SHUT_WR)
                while _unsent(client) and monotonic() < until and not self._run.pressed():
                    select([], [], [], POLL / 10)
                while select([client], [], [], 0)[0] and client.recv(4096):
                    pass
            except OSError:
                pass  # the client has gone
            self._drop()

    def _attend(self) -> None:
        """Greet a client that comes, and obey the one that is here; wait where the run has to."""
        run = self._run
        while True:
            self._greet()
            waits = self._paused or (self._wait and not self._ready)
            one = self._client if self._client is not None else self._server
            if run.pressed() or run.ended or not (select([one], [], [], POLL if waits else 0)[0] or waits):
                return
            if self._client is not None:
                self._obey()

    def _greet(self) -> None:
        if self._client is not None:
            return
        try:
            client, _ = self._server.accept()
        except OSError:
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._apart, self._last = client, 1, None
        self._send(greeting(self._boxed))

    def _obey(self) -> None:
        """Read a packet of the client, if one is there, and obey the command in the packet."""
        data = self._read(HEAD_BYTES)
        if not data:
            return
        kind, number = read_head(data)
        if kind == Kind.GO:
            self._ready = True
        elif kind in (Kind.PAUSE, Kind.RESUME):
            self._paused = kind == Kind.PAUSE
        elif kind == Kind.TRATE:
            self._apart = max(number, 1)
        elif kind == Kind.WAIT:
            self._wait = bool(number)
        elif kind == Kind.KILL:
            self._run.ended = KILLED
        elif kind == Kind.MDCOMM and 0 <= number <= len(self._ids):
            self._read(FORCE_BYTES * number)
            if PUSHED not in self._run.record.warnings:
                self._run.record.warnings.append(PUSHED)
        else:  # a disconnect, or no client of this protocol
            self._drop()

    def _read(self, count: int) -> bytes:
        """So many bytes of the client, or none if nothing has come. A client that goes is dropped."""
        found, until = b"", monotonic() + LINGER
        while self._client is not None and len(found) < count:
            if not select([self._client], [], [], POLL if found else 0)[0]:
                if not found:
                    break
                if self._run.pressed() or monotonic() > until:
                    self._drop()  # the rest of the packet does not come
                continue
            try:
                more = self._client.recv(count - len(found))
            except OSError:
                more = b""
            if not more:
                self._drop()
            found += more
        return found if len(found) == count else b""

    def _send(self, data: bytes) -> None:
        """Send all bytes, and wait for a client that is slow. A client that goes is dropped."""
        left = memoryview(data)
        while self._client is not None and left:
            if self._run.pressed():
                return self._drop()
            if select([], [self._client], [], POLL)[1]:
                try:
                    left = left[self._client.send(left) :]
                except OSError:
                    self._drop()
        return None

    def _drop(self) -> None:
        """Let the client go."""
        if self._client is not None:
            self._client.close()
        self._client, self._ready, self._paused = None, False, False

    def _frame(self) -> Frame:
        """The current look."""
        run = self._run
        state = run.flow.shared_state(run.y, run.time, run.steps_done)  # type: ignore[union-attr]
        seen = run.record.looks.observables(run.record.looks.count - 1)
        temperature, total, potential = (
            float(seen.get(name, np.nan)) for name in ("temperature", "total_energy", "potential_energy")
        )
        dt = run.dt if run.dt is not None else run.stepper.last_step
        box = state.box.matrix if self._boxed else None
        x, v, f = (self._in_order(state.ids, each) for each in (state.positions, state.velocities, forces_at(run)))
        return Frame(dt, run.time, run.steps_done, temperature, total, potential, box, x, v, f)

    def _in_order(self, ids: np.ndarray, values: Floats) -> Floats:
        """The rows of the bodies of the start; nan for bodies that have left. Bodies that came are not sent."""
        if np.array_equal(ids, self._ids):
            return values
        found = np.full((len(self._ids), 3), np.nan)
        place = {each: k for k, each in enumerate(self._ids.tolist())}
        for each, row in zip(ids.tolist(), values, strict=True):
            if each in place:
                found[place[each]] = row
        return found


def _unsent(client: socket.socket) -> bool:
    """Whether bytes are on their way to the client; False where the machine cannot tell."""
    try:
        from fcntl import ioctl
        from termios import TIOCOUTQ
    except ImportError:  # on Windows
        return False
    return ioctl(client.fileno(), TIOCOUTQ, bytes(4)) != bytes(4)
