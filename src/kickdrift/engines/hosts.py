"""Other machines for the processes of an engine: the hosts file, and connections over the network.

Each connection begins with two challenges, by which both sides prove that they know the run's random key. What follows
is not encrypted: like MPI itself, the connections belong in a trusted network.
"""

from __future__ import annotations

import os
import re
import socket
import struct
from collections.abc import Mapping
from multiprocessing import AuthenticationError
from multiprocessing.connection import Connection, answer_challenge, deliver_challenge

from kickdrift.disk.files import content, shown_path
from kickdrift.errors import InputError
from kickdrift.text import shown

MOST_BYTES = 2**20  # of a hosts file
MOST_ON_ONE, MOST = 1024, 4096  # processes on one machine, and in all
KEY_BYTES = 32
ANSWER_SECONDS = 10  # limit for each answer to a challenge
# options of a connection, in seconds and milliseconds: a machine that is silent for a minute is gone
SILENCE = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 60_000}
_LINE = re.compile(r"(?P<name>[A-Za-z0-9._-]+)(:(?P<count>[1-9][0-9]{0,8}))?")


def slots(file: str | os.PathLike[str]) -> dict[str, int]:
    """Return the machines of a hosts file, and the number of processes that each takes.

    The format is that of MPICH's mpiexec: a line for each machine, ``name`` or ``name:count``; ``#`` begins a comment.
    Raises InputError for a file that cannot be read or names no machine, for a line of another form, and for more
    processes than any machine takes."""
    try:
        lines = content(file, MOST_BYTES, "a hosts file").decode().splitlines()
    except UnicodeDecodeError:
        raise InputError(f"hosts: {shown_path(file)}: is not a text file") from None
    except InputError as error:
        raise InputError(f"hosts: {error}") from None
    found: dict[str, int] = {}
    for number, line in enumerate(lines, 1):
        if not (words := line.partition("#")[0].strip()):
            continue
        where = f"hosts: {shown_path(file)}, line {number}:"
        if not (parts := _LINE.fullmatch(words)):
            raise InputError(f"{where} {shown(words)} is not NAME or NAME:COUNT")
        name = parts["name"]
        found[name] = found.get(name, 0) + int(parts["count"] or 1)
        if found[name] > MOST_ON_ONE:
            raise InputError(f"{where} {shown(name)} has {found[name]:,} processes; a machine takes {MOST_ON_ONE:,}")
        if sum(found.values()) > MOST:
            raise InputError(f"{where} more than {MOST:,} processes, which is the limit for a run")
    if not found:
        raise InputError(f"hosts: {shown_path(file)}: names no machine")
    return found


def on_this_machine(hosts: Mapping[str, int], count: int) -> int:
    """Number of processes, of ``count``, that mpiexec starts here: it fills one machine after the other, again and
    again. Raises InputError for too many, on one machine or in all."""
    if count > MOST:
        raise InputError(f"processes: {count:,} are more than {MOST:,}, which is the limit for a run")
    rounds, left = divmod(count, sum(hosts.values()))
    here = 0
    for name, slots in hosts.items():
        part = rounds * slots + min(left, slots)
        left -= min(left, slots)
        if part > MOST_ON_ONE:
            raise InputError(f"processes: {part:,} would run on {shown(name)}; a machine takes {MOST_ON_ONE:,}")
        here += part if _is_here(name) else 0
    return here


def _is_here(name: str) -> bool:
    try:
        there, own = _ends(name)
    except OSError:
        return False
    return there == own or there.startswith(("127.", "0."))


def address_towards(names: list[str]) -> str:
    """Return this machine's address as the first other machine sees it; the local address if there is no other.

    Raises InputError for a name without an address, and for a machine without a route."""
    for name in names:
        try:
            there, own = _ends(name)
        except OSError as error:
            raise InputError(f"hosts: machine {name!r} cannot be reached: {error.strerror or error}") from None
        if own != there:
            return own
    return "127.0.0.1"


def _ends(name: str) -> tuple[str, str]:
    """A machine's address, and this machine's address as the other one sees it."""
    there = socket.getaddrinfo(name, 9, socket.AF_INET, socket.SOCK_DGRAM)[0][4]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        asking.connect(there)  # sends nothing: the system chooses the route
        return str(there[0]), str(asking.getsockname()[0])


def listening(address: str, count: int) -> socket.socket:
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
