"""A page on this machine that follows a run. Only who has the address with its token can read the page."""

import hmac
import json
import secrets
import socket
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedReader, RawIOBase
from threading import Condition, Lock, Semaphore, Thread
from time import monotonic
from typing import Any, ClassVar
from urllib.parse import parse_qs, urlsplit

from kickdrift.errors import InputError
from kickdrift.run.simulation import Simulation
from kickdrift.text import clean
from kickdrift.view.live import END, FRAME, NEWEST, Feed
from kickdrift.view.page import POLICY, page_of

HOST = "127.0.0.1"
PORTS = 65535
MOST_PAGES = 16  # open at a time
MOST_CALLS = 64  # connections at a time without the token; for one more, the oldest of them is closed
MOST_THREADS = 4 * MOST_CALLS  # more connections are closed unheard, so that nobody fills the run's process
TAKEN = 10.0  # seconds that a page may take over a part of an answer
HEARD = 5.0  # seconds at most until a whole request has come
MOST_HEARD = 64 * 1024  # bytes at most of a request
KEPT = 1000  # messages of text and curves that a page may miss while it loads
SILENCE = 5.0  # seconds without news after which a sign of life is sent
LAST = 2.0  # seconds at most in which pages may take the last frame

START = (
    NEWEST
    + """\
const scene = JSON.parse(document.getElementById("scene").textContent);
const view = await globalThis.kickdriftView.mount(document.getElementById("view"), scene, {live: true});
globalThis.view = view;
view.focus();
view.say(scene.status);
const address = new URL("events", location.href);
address.search = location.search;
address.searchParams.set("after", scene.after);
const source = new EventSource(address);
const show = newest((frame) => view.append(frame));
source.addEventListener("told", async (event) => {
  const {step, text, curves} = JSON.parse(event.data);
  document.body.dataset.step = step;
  view.say(text);
  await view.addCurves(curves);
});
let shown = Promise.resolve();
source.addEventListener("frame", (event) => { shown = Promise.all([shown, show(JSON.parse(event.data))]); });
source.addEventListener("end", async () => { source.close(); await shown; view.live = false; });
source.addEventListener("error", () => { source.close(); view.say("The connection to the run has ended."); });
"""
)


class Reader:
    """Messages that one open page has not yet received. A page that is slow gets the newest frame alone."""

    def __init__(self, missed: list[tuple[str, str]]) -> None:
        self.told, self.frame = deque(missed), ""

    def take(self) -> list[tuple[str, str]]:
        """Messages to send now."""
        found = [*self.told, *([(FRAME, self.frame)] if self.frame else [])]
        self.told.clear()
        self.frame = ""
        return sorted(found, key=lambda each: each[0] == END)


class Server:
    """Serves the page of a Simulation, in threads of its own.

    Attributes
    ----------
    address : of the page, with its token
    feed : Feed
        Follows the Simulation.
    """

    def __init__(self, sim: Simulation, port: int = 0) -> None:
        self.token = secrets.token_urlsafe(24)
        self.feed = Feed(sim, self.send, lambda: bool(self._readers))
        self.news = Condition()
        self._readers: list[Reader] = []
        self._told: deque[tuple[int, str, str]] = deque(maxlen=KEPT)
        self._count = 0
        self.over = False
        if not 0 <= port <= PORTS:
            raise InputError(f"live: a port is a whole number from 1 to {PORTS}, got {port}")
        try:
            self._http = _Http((HOST, port), _Handler)
        except OSError as error:
            raise InputError(f"live: port {port} of {HOST}: {error.strerror}; give another port") from None
        self._http.owner = self
        self.port = int(self._http.server_address[1])
        self.hosts = (f"{HOST}:{self.port}", f"localhost:{self.port}")
        self.address = f"http://{HOST}:{self.port}/?token={self.token}"
        self._thread = Thread(target=self._serve, name="kickdrift live", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        """Answer requests. The thread sleeps between two of them, and never asks for the run's time."""
        while not self.over:
            self._http.handle_request()

    def close(self) -> None:
        """Wait until open pages have the last frame, and stop."""
        until = monotonic() + LAST
        with self.news:
            self.over = True
            self.news.notify_all()
            while self._readers and (left := until - monotonic()) > 0:
                self.news.wait(left)
        with suppress(OSError), socket.create_connection((HOST, self.port), timeout=LAST):
            self._thread.join(LAST)  # the connection has woken it
        self._http.server_close()

    def send(self, kind: str, content: dict[str, Any]) -> None:
        """Give a message to all open pages."""
        text = json.dumps(content, allow_nan=False, separators=(",", ":"))
        with self.news:
            if kind != FRAME:
                self._count += 1
                self._told.append((self._count, kind, text))
            for reader in self._readers:
                if kind == FRAME:
                    reader.frame = text
                else:
                    reader.told.append((kind, text))
            self.news.notify_all()

    def page(self) -> str:
        """The page, with the number of the last message that it need not get."""
        with self.feed.lock:
            scene = self.feed.scene() | {"after": self._count}
        return page_of(scene, START, f"{POLICY}; connect-src 'self'")

    @contextmanager
    def reading(self, after: int) -> Iterator[Reader | None]:
        """A reader that gets the messages after this one; None if too many pages are open."""
        with self.news:
            reader = None
            if len(self._readers) < MOST_PAGES and not self.over:
                reader = Reader([(kind, text) for number, kind, text in self._told if number > after])
                self._readers.append(reader)
        if reader is None:
            yield None
            return
        try:
            yield reader
        finally:
            with self.news:
                self._readers.remove(reader)
                self.news.notify_all()


class _Http(ThreadingHTTPServer):
    """A server whose connections without the token give way to new ones, so that they never shut out the page."""

    daemon_threads = True
    block_on_close = False
    owner: Server

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self._free = Semaphore(MOST_THREADS)
        self._strangers: dict[int, socket.socket] = {}  # connections that have not shown the token, the oldest first
        self._lock = Lock()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether a thread may answer the connection."""
        if not self._free.acquire(blocking=False):
            return False
        with self._lock:
            if len(self._strangers) >= MOST_CALLS:
                self._hang_up(next(iter(self._strangers)))
            self._strangers[id(request)] = request
        return True

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and make room for another connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def shutdown_request(self, request: Any) -> None:
        self.know(request)
        super().shutdown_request(request)

    def know(self, request: Any) -> bool:
        """Take a connection off the strangers, since it has the token or ends; False if it was closed already."""
        with self._lock:
            return self._strangers.pop(id(request), None) is not None

    def _hang_up(self, key: int) -> None:
        """Close a stranger's connection, so that its thread ends."""
        with suppress(OSError):
            self._strangers.pop(key).shutdown(socket.SHUT_RDWR)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of pages that were closed."""


class _Request(RawIOBase):
    """The bytes of a request, which has to come whole within HEARD seconds."""

    def __init__(self, line: socket.socket) -> None:
        self._line, self._until, self._left = line, monotonic() + HEARD, MOST_HEARD

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        """Read some bytes; raise TimeoutError once the time or the length is used up."""
        left = self._until - monotonic()
        if left <= 0 or self._left <= 0:
            raise TimeoutError
        self._line.settimeout(left)
        read = self._line.recv_into(buffer, min(len(buffer), self._left))
        self._left -= read
        return read


class _Handler(BaseHTTPRequestHandler):
    """Answers a request that names this machine and has the token."""

    server: _Http
    server_version, sys_version = "kickdrift", ""
    heads: ClassVar[dict[str, str]] = {
        "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Cross-Origin-Resource-Policy": "same-origin",
    }

    def setup(self) -> None:
        """Prepare to read one request."""
        super().setup()
        self.rfile.close()
        self.rfile = BufferedReader(_Request(self.connection))

    def parse_request(self) -> bool:
        """Read the whole request; then a page may take as long as TAKEN over each part of the answer."""
        try:
            return super().parse_request()
        finally:
            self.connection.settimeout(TAKEN)

    def do_GET(self) -> None:
        """Send the page, or what happens from now on."""
        owner = self.server.owner
        try:
            asked = urlsplit(self.path)
            words = parse_qs(asked.query, max_num_fields=8)
        except ValueError:
            return self._refuse(400, "the address cannot be read")
        token = words.get("token", [""])[0]
        if self.headers.get("Host") not in owner.hosts:
            return self._refuse(403, "this page has another address")
        if not hmac.compare_digest(token.encode(), owner.token.encode()):
            return self._refuse(403, "the address needs the token that the terminal shows")
        if not self.server.know(self.connection):
            return None  # it came too late, and was closed for a newer one
        if asked.path == "/":
            return self._answer(200, "text/html; charset=utf-8", owner.page().encode())
        after = words.get("after", ["0"])[0]
        if asked.path == "/events" and after.isascii() and after.isdigit() and len(after) < 16:
            with owner.reading(int(after)) as reader:
                return self._stream(owner, reader) if reader else self._refuse(503, "too many pages are open")
        return self._refuse(404, "there is no such page")

    def _stream(self, owner: Server, reader: Reader) -> None:
        """Send messages as server-sent events until the run is over or the page is closed."""
        self._head(200, "text/event-stream")
        self.end_headers()
        while True:
            with owner.news:
                if not (reader.told or reader.frame or owner.over):
                    owner.news.wait(SILENCE)
                found = reader.take()
            lines = [f"event: {kind}\ndata: {text}\n\n" for kind, text in found] or [":\n\n"]
            self.wfile.write("".join(lines).encode())
            if any(kind == END for kind, _ in found) or (owner.over and not found):
                return

    def _head(self, status: int, kind: str) -> None:
        self.send_response(status)
        for name, value in {**self.heads, "Content-Type": kind, "Connection": "close"}.items():
            self.send_header(name, value)

    def _answer(self, status: int, kind: str, body: bytes) -> None:
        self._head(status, kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _refuse(self, status: int, why: str) -> None:
        self._answer(status, "text/plain; charset=utf-8", f"{why}\n".encode())

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal belongs to the run."""


@contextmanager
def live_page(sim: Simulation, port: int) -> Iterator[Feed]:
    """Serve the page of a Simulation, print its address on standard error, and yield what follows the run."""
    server = Server(sim, port)
    try:
        print(f"live view: {clean(server.address)}", file=sys.stderr, flush=True)
        yield server.feed
    finally:
        server.close()
