"""The program that reads a stream by IMD, version 3: its commands, the frame on its way, and the packets.

Source: the specification of imdclient, https://imdclient.readthedocs.io/en/latest/protocol_v3.html. Heads of packets
are big-endian, bodies have the byte order of this machine. Nothing here waits.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from enum import IntEnum
from time import monotonic
from typing import NamedTuple

import numpy as np

from kickdrift.model.state import Floats
from kickdrift.model.units import constants
from kickdrift.model.units.file_units import FileUnits
from kickdrift.model.units.unit_systems import UnitSystem

VERSION = 3
HEAD_BYTES = 8
FORCE_BYTES = 16  # bytes for each particle of MDCOMM: an index and three numbers
MOST_STEPS = 2**31 - 1  # in the packet of energies; the packet of the time has 64 bits

_PER_MOL = {
    "eV": constants.ELEMENTARY_CHARGE * constants.AVOGADRO / 1000,
    "kcal/mol": 4.184,
    "kJ/mol": 1.0,
    "J": constants.AVOGADRO / 1000,
}
AT_ONCE = 65536  # bytes read at a time
BODY_READS = 16  # of these, at most, while forces are passed over


class Kind(IntEnum):
    """Kinds of packets."""

    DISCONNECT = 0
    ENERGIES = 1
    POSITIONS = 2
    GO = 3
    HANDSHAKE = 4
    KILL = 5
    MDCOMM = 6
    PAUSE = 7
    TRATE = 8
    IOERROR = 9
    SESSION = 10
    RESUME = 11
    TIME = 12
    BOX = 13
    VELOCITIES = 14
    FORCES = 15
    WAIT = 16


class Units(NamedTuple):
    """Factors from a system's units to the protocol's: angstrom, ps and kJ/mol.

    All factors are 1 where the units have no value in these, as in reduced units: then the numbers stay as they are."""

    length: float = 1.0
    time: float = 1.0
    energy: float = 1.0

    @classmethod
    def of(cls, units: UnitSystem) -> Units:
        found, energy = FileUnits.of(units), _PER_MOL.get(units.energy)
        return cls() if found.nominal or energy is None else cls(found.length, found.time, energy)


class Frame(NamedTuple):
    """A frame's numbers, in the system's units.

    Attributes
    ----------
    dt, time, step : length of a step, time, number of the step
    temperature, total, potential : of all particles
    box : (3, 3) edges in rows; None if the box is open along an axis
    positions, velocities, forces : (n, 3)
    """

    dt: float
    time: float
    step: int
    temperature: float
    total: float
    potential: float
    box: Floats | None
    positions: Floats
    velocities: Floats
    forces: Floats


def head(kind: int, number: int) -> bytes:
    return struct.pack("!ii", kind, number)


def read_head(data: bytes) -> tuple[int, int]:
    kind, number = struct.unpack("!ii", data)
    return kind, number


def greeting(box: bool) -> bytes:
    """Handshake, and what each frame holds: all but a box in open space; positions are not wrapped into the box."""
    shake = struct.pack("!i", Kind.HANDSHAKE) + struct.pack("=i", VERSION)
    return shake + head(Kind.SESSION, 7) + bytes([1, 1, box, 1, 0, 1, 1])


def packets(frame: Frame, units: Units) -> bytes:
    """All packets of a frame, in the protocol's order. Energies of single forces are not known apart: they are 0."""
    n = len(frame.positions)
    time = struct.pack("=ddq", frame.dt * units.time, frame.time * units.time, frame.step)
    energies = np.array([frame.temperature, frame.total * units.energy, frame.potential * units.energy, *[0.0] * 6])
    parts = [head(Kind.TIME, 1), time, head(Kind.ENERGIES, 1)]
    parts += [struct.pack("=i", min(frame.step, MOST_STEPS)), _floats(energies)]
    if frame.box is not None:
        parts += [head(Kind.BOX, 1), _floats(frame.box * units.length)]
    parts += [head(Kind.POSITIONS, n), _floats(frame.positions * units.length)]
    parts += [head(Kind.VELOCITIES, n), _floats(frame.velocities * (units.length / units.time))]
    parts += [head(Kind.FORCES, n), _floats(frame.forces * (units.energy / units.length))]
    return b"".join(parts)


def _floats(values: Floats) -> bytes:
    """The values as float32; numbers beyond its range are infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32).tobytes()


class Client:
    """One connection, with what the program asked for. All of that ends with the connection.

    Attributes
    ----------
    ready, paused : whether the program has said go; whether it has said pause
    waits : whether the run waits for this program, once it has said so; None before
    apart : least number of steps between two frames
    last : step of the last frame
    gone : whether the program has closed the connection
    since : by the clock, when the program came or last took bytes
    """

    def __init__(self, line: socket.socket) -> None:
        line.setblocking(False)
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.line = line
        self.ready = self.paused = self.gone = False
        self.waits: bool | None = None
        self.apart = 1
        self.last: int | None = None
        self.since = monotonic()
        self._come, self._over = bytearray(), 0  # bytes of packets that are not whole; bytes to pass over
        self._left = memoryview(b"")

    @property
    def behind(self) -> bool:
        """Whether a part of a frame is still to be sent."""
        return bool(self._left)

    def send(self, data: bytes) -> None:
        """Begin to send bytes; what the connection does not take at once, `push` sends later."""
        self._left = memoryview(bytes(self._left) + data)
        self.push()

    def push(self) -> None:
        """Send what the connection takes now."""
        while self._left and not self.gone:
            try:
                sent = self.line.send(self._left)
            except BlockingIOError:
                return
            except OSError:
                self.gone = True
                return
            self._left, self.since = self._left[sent:], monotonic()

    def commands(self, most: int) -> Iterator[tuple[int, int]]:
        """Heads of the packets that have come whole, without forces' bodies of up to ``most`` particles."""
        for _ in range(BODY_READS):
            self._receive()
            if not self._over:
                break
        while len(self._come) >= HEAD_BYTES and not self._over:
            kind, number = read_head(bytes(self._come[:HEAD_BYTES]))
            del self._come[:HEAD_BYTES]
            if kind == Kind.MDCOMM and 0 <= number <= most:
                self._over = FORCE_BYTES * number
                self._pass_over()
            yield kind, number

    def _receive(self) -> None:
        """Read the bytes that have arrived, at most ``AT_ONCE`` of them."""
        try:
            more = self.line.recv(AT_ONCE)
        except BlockingIOError:
            return
        except OSError:
            more = b""
        self.gone = self.gone or not more
        self._come += more
        self._pass_over()

    def _pass_over(self) -> None:
        passed = min(self._over, len(self._come))
        del self._come[:passed]
        self._over -= passed
