"""Other machines for the processes of an engine: the hosts file, and connections over the network.

Each connection begins with two challenges, by which both sides prove that they know the run's random key. What follows
is not encrypted: like MPI itself, the connections belong in a trusted network.
"""

from __future__ import annotations

import os
import re
import socket
import struct
from multiprocessing import AuthenticationError
from multiprocessing.connection import Connection, answer_challenge, deliver_challenge
from pathlib import Path

from kickdrift.errors import InputError

KEY_BYTES = 32
ANSWER_SECONDS = 10  # limit for each answer to a challenge
# options of a connection, in seconds and milliseconds: a machine that is silent for a minute is gone
SILENCE = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 60_000}
_LINE = re.compile(r"(?P<name>[A-Za-z0-9._-]+)(:(?P<count>[1-9][0-9]{0,5}))?")


def slots(file: str | os.PathLike[str]) -> dict[str, int]:
    """Return the machines of a hosts file, and the number of processes that each takes.

    The format is that of MPICH's mpiexec: a line for each machine, ``name`` or ``name:count``; ``#`` begins a comment.
    Raises InputError for a file that is missing or names no machine, and for a line of another form."""
    try:
        lines = Path(file).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"hosts: {file} cannot be read: {getattr(error, 'strerror', None) or 'not text'}") from None
    found: dict[str, int] = {}
    for number, line in enumerate(lines, 1):
        if not (words := line.partition("#")[0].strip()):
            continue
        if not (parts := _LINE.fullmatch(words)):
            raise InputError(f"hosts: {file}, line {number}: {words!r} is not NAME or NAME:COUNT")
        found[parts["name"]] = found.get(parts["name"], 0) + int(parts["count"] or 1)
    if not found:
        raise InputError(f"hosts: {file} names no machine")
    return found


def address_towards(names: list[str]) -> str:
    """Return this machine's address as the first other machine sees it; the local address if there is no other.

    Raises InputError for a name without an address, and for a machine without a route."""
    for name in names:
        try:
            there = socket.getaddrinfo(name, 9, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
                asking.connect(there)  # sends nothing: the system chooses the route
                own = str(asking.getsockname()[0])
        except OSError as error:
            raise InputError(f"hosts: machine {name!r} cannot be reached: {error.strerror or error}") from None
        if own != there[0]:
            return own
    return "127.0.0.1"


def listening(address: str, count: int) -> socket.socket:
    """Listen on a free port of the address."""
    return socket.create_server((address, 0), backlog=count)


def accepted(stream: socket.socket, key: bytes) -> Connection | None:
    """Return the connection if the other side knows the key; None otherwise."""
    _wait_at_most(stream, ANSWER_SECONDS)
    connection = Connection(stream.detach())
    try:
        deliver_challenge(connection, key)
        answer_challenge(connection, key)
    except (AuthenticationError, OSError, EOFError):
        connection.close()
        return None
    return _ready(connection)


def connected(address: str, key: bytes) -> Connection:
    """Connect to ``host:port``. Raises AuthenticationError if the other side does not know the key."""
    host, _, port = address.rpartition(":")
    stream = socket.create_connection((host, int(port)), ANSWER_SECONDS)
    stream.setblocking(True)
    _wait_at_most(stream, ANSWER_SECONDS)
    connection = Connection(stream.detach())
    answer_challenge(connection, key)
    deliver_challenge(connection, key)
    return _ready(connection)


def _ready(connection: Connection) -> Connection:
    """Take the limit for answers off, and notice a machine that disappears."""
    with socket.socket(fileno=connection.fileno()) as stream:
        _wait_at_most(stream, 0)
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in ({"TCP_NODELAY": 1} | SILENCE).items():
            if (option := getattr(socket, name, None)) is not None:  # systems differ
                stream.setsockopt(socket.IPPROTO_TCP, option, value)
        stream.detach()
    return connection


def _wait_at_most(stream: socket.socket, seconds: int) -> None:
    """Limit the time of one read; 0 sets no limit. A socket's own timeout would not hold for the Connection."""
    stream.setblocking(True)
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", seconds, 0))
