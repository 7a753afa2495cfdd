"""The program that reads a stream by IMD: its commands, and the frame on its way. Nothing here waits."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from time import monotonic

from kickdrift.run.watchers.imd_packets import FORCE_BYTES, HEAD_BYTES, Kind, read_head

AT_ONCE = 65536  # bytes read at a time
BODY_READS = 16  # of these, at most, while forces are passed over


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
        """Take in some of what has come."""
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
