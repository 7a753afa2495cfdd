"""The watcher that streams a run by IMD, the protocol for interactive molecular dynamics, to one client at a time."""

from __future__ import annotations

import socket
from select import select
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.disk.posix import unsent
from kickdrift.display.pace import SHORT, notice
from kickdrift.errors import InputError
from kickdrift.looks.record import OBSERVING
from kickdrift.model.checks.values import whole_number
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.present import forces_at
from kickdrift.run.watcher import Watcher
from kickdrift.run.watchers.imd_client import Client, Frame, Kind, Units, greeting, packets
from kickdrift.text import counted, shown

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration
    from kickdrift.run.report.report import Report

HOST = "127.0.0.1"
PORT = 8888  # as in GROMACS
POLL = 0.1  # seconds between two checks for Ctrl-C while the run waits
LINGER = 5.0  # seconds at most in which a client says go, and in which the last frames may reach it
PATIENCE = 60.0  # seconds at most in which a client for which the run waits may take nothing
PORTS = 65535
KILLED = "by the IMD client"
NOBODY, PAUSED, SLOW = "no program reads", "the program that reads has paused it", "the program that reads is slow"
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

    The run waits for nobody, except where it was asked to: see `_reason_to_wait`. A client that is slow misses frames.

    Parameters
    ----------
    run : the Integration to stream
    port : where to listen, on this machine alone
    wait : whether the run waits while no client reads
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
        self._client: Client | None = None
        self._missed = 0  # frames
        self._said: set[str] = set()  # reasons to wait that the terminal has told
        self._server = listening(port)

    def begin(self) -> None:
        """Wait for a client, if asked."""
        self._server.setblocking(False)
        self._attend()

    def look(self) -> None:
        """Send the look to the client that listens."""
        self._attend()
        client, step = self._client, self._run.steps_done
        if client is None or not client.ready or self._run.ended:
            return
        if client.last is not None and abs(step - client.last) < client.apart:
            return
        if client.behind:
            self._missed += 1
            return
        client.send(packets(self._frame(), self._units))
        client.last = step

    def pause(self) -> None:
        """Obey the client between two looks."""
        self._attend()

    def end(self) -> None:
        """Tell of frames that were left out."""
        if self._missed:
            self._warn(f"the IMD client was slow and missed {counted(self._missed, 'frame', ',')}")

    def close(self, report: Report | None) -> None:
        """Let the last frames reach the client, and close the sockets."""
        self._server.close()
        if self._client is None:
            return
        client, until = self._client, monotonic() + LINGER
        while client.behind and not client.gone and monotonic() < until and not self._run.pressed():
            client.push()
            select([], [], [], POLL / 10)
        try:
            client.line.shutdown(socket.SHUT_WR)
            while unsent(client.line.fileno()) and monotonic() < until and not self._run.pressed():
                select([], [], [], POLL / 10)
            while select([client.line], [], [], 0)[0] and client.line.recv(4096) and monotonic() < until:
                pass
        except OSError:
            pass  # the client has gone
        self._drop()

    def _attend(self) -> None:
        """Greet a client that comes, and obey the one that is here; wait where the run has to."""
        run, began, told = self._run, monotonic(), ""
        while True:
            self._greet()
            self._obey()
            why = self._reason_to_wait()
            if not why or run.pressed() or run.ended:
                break
            if why not in self._said and monotonic() - began > SHORT:
                self._said.add(why)
                told = why
                notice(f"imd: the run waits: {why}")
            client = self._client
            lines = [self._server] if client is None else [client.line]
            select(lines, lines if client and client.behind else [], [], POLL)
        if told and not run.ended and not run.pressed():
            notice("imd: the run goes on")

    def _reason_to_wait(self) -> str:
        """Why the run has to wait now; "" if it has not. Drops a client that kept the run waiting for too long."""
        client = self._client
        if client is None:
            return NOBODY if self._wait else ""
        silent = monotonic() - client.since
        if not client.ready and silent > LINGER:
            self._drop()
            return self._reason_to_wait()
        if client.paused:
            return PAUSED
        if not (self._wait if client.waits is None else client.waits):
            return ""
        if client.behind and silent > PATIENCE:
            self._drop()
            return self._reason_to_wait()
        return "" if client.ready and not client.behind else SLOW if client.behind else NOBODY

    def _greet(self) -> None:
        """Take in a client, if one comes and the place is free."""
        if self._client is not None:
            return
        try:
            line, _ = self._server.accept()
        except OSError:
            return
        self._client = Client(line)
        self._client.send(greeting(self._boxed))

    def _obey(self) -> None:
        """Obey the commands that have come whole, and send what the connection takes."""
        client = self._client
        if client is None:
            return
        client.push()
        for kind, number in client.commands(len(self._ids)):
            if kind == Kind.GO:
                client.ready = True
            elif kind in (Kind.PAUSE, Kind.RESUME):
                client.paused = kind == Kind.PAUSE
            elif kind == Kind.TRATE:
                client.apart = max(number, 1)
            elif kind == Kind.WAIT:
                client.waits = bool(number)
            elif kind == Kind.KILL:
                self._run.ended = KILLED
            elif kind == Kind.MDCOMM and 0 <= number <= len(self._ids):
                self._warn(PUSHED)
            else:  # a disconnect, or no client of this protocol
                client.gone = True
                break
        if client.gone:
            self._drop()

    def _warn(self, text: str) -> None:
        if text not in self._run.record.warnings:
            self._run.record.warnings.append(text)

    def _drop(self) -> None:
        """Let the client go, with all that it asked for."""
        if self._client is not None:
            self._client.line.close()
        self._client = None

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
