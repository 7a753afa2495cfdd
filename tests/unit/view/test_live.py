"""Live pages: who may read them, what they are told, and that the run keeps its bits."""

from __future__ import annotations

import http.client
import json
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.view import live
from kickdrift.view import server as serving
from kickdrift.view.packing import restored, unpacked
from kickdrift.view.scene import phase_of
from kickdrift.view.server import MOST_PAGES, Server
from kickdrift.view.stage import Stage
from tests.systems import liquid


@pytest.fixture
def sim() -> kd.Simulation:
    return kd.Simulation(liquid(), dt=0.001)


@pytest.fixture
def server(sim: kd.Simulation) -> Iterator[Server]:
    found = Server(sim)
    yield found
    found.close()


def asked(server: Server, path: str, host: str | None = None) -> tuple[int, str, Any]:
    """Status, text and head of an answer."""
    there = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    there.request("GET", path, headers={} if host is None else {"Host": host})
    answer = there.getresponse()
    text = answer.read().decode()
    there.close()
    return answer.status, text, answer.headers


def test_only_the_address_with_its_token_shows_the_page(server):
    status, text, heads = asked(server, f"/?token={server.token}")
    assert status == 200
    assert "connect-src 'self'" in text
    assert heads["Cache-Control"] == "no-store"
    assert heads["X-Frame-Options"] == "DENY"
    wrong = server.token[:-1] + ("a" if server.token[-1] != "a" else "b")
    for path in ("/", "/?token=", f"/?token={wrong}", "/events", f"/events?token={wrong}", "/?token=%C3%A9"):
        status, text, _ = asked(server, path)
        assert status == 403, path
        assert server.token not in text
    assert asked(server, f"/x?token={server.token}")[0] == 404
    assert asked(server, f"/events?token={server.token}&after=x")[0] == 404
    assert server.address == f"http://127.0.0.1:{server.port}/?token={server.token}"
    assert len(server.token) >= 32


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", ""])
def test_a_page_of_another_name_that_leads_here_is_refused(server, host):
    assert asked(server, f"/?token={server.token}", host)[0] == 403


def test_a_page_by_the_name_localhost_is_shown(server):
    assert asked(server, f"/?token={server.token}", f"localhost:{server.port}")[0] == 200


def test_the_page_listens_to_this_machine_alone_and_tokens_differ(sim, server):
    assert server._http.server_address[0] == "127.0.0.1"
    other = Server(sim)
    assert other.token != server.token
    other.close()


def heard(server: Server, after: int, into: list[tuple[str, Any]]) -> threading.Thread:
    """Read all events in a thread."""
    there = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    there.request("GET", f"/events?token={server.token}&after={after}")
    answer = there.getresponse()
    assert answer.status == 200

    def read() -> None:
        events = re.findall(r"event: (\w+)\ndata: (.+)", answer.read().decode())
        into.extend((kind, json.loads(text)) for kind, text in events)
        there.close()

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    return thread


def test_a_page_is_told_frames_curves_and_the_end_and_the_run_keeps_its_bits(sim, server, monkeypatch):
    monkeypatch.setattr(live, "APART", 0.0)
    monkeypatch.setattr(live, "SHARE", 1.0)
    monkeypatch.setattr(live, "FEWER", np.inf)
    text = asked(server, f"/?token={server.token}")[1]
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', text, re.DOTALL)[1])  # type: ignore[index]
    events: list[tuple[str, Any]] = []
    reader = heard(server, scene["after"], events)
    sim.followers.append(server.feed)
    sim.run(2000, every=10)
    reader.join(30)
    assert not reader.is_alive()
    told = [content for kind, content in events if kind == "told"]
    frames = [content for kind, content in events if kind == "frame"]
    assert events[-1][0] == "end"
    steps = [each["step"] for each in told]
    assert steps == sorted(steps)
    assert steps[-1] == 2000
    assert told[-1]["text"] == "finished at step 2,000"
    curves = [curve for each in told for curve in each["curves"] if curve["name"] == "energy error"]
    times, errors = (np.concatenate([unpacked(each[name]) for each in curves]) for name in ("times", "values"))
    samples = sim.record.samples
    np.testing.assert_array_equal(times, [each.time for each in samples])
    totals = np.array([each.energies.total for each in samples])
    np.testing.assert_allclose(errors, (totals - totals[0]) / abs(totals[0]), rtol=1e-12, atol=1e-15)
    last = frames[-1]
    assert unpacked(last["steps"]).tolist() == [2000]
    parts = restored(unpacked(last["positions"]))[0].T
    box = np.diag(sim.system.box.matrix)
    off = (parts * box - sim.state.positions) / box
    assert np.abs(off - np.round(off)).max() < 2e-5
    alone = kd.Simulation(liquid(), dt=0.001)
    alone.run(2000, every=10)
    np.testing.assert_array_equal(alone.state.phase, sim.state.phase)
    assert [each.energies for each in alone.record.samples] == [each.energies for each in samples]


@pytest.mark.parametrize(
    "asked",
    [{"temperature": 1.5, "to": 1.0}, {"temperature": 1.0, "integrator": "langevin", "friction": 1.0, "seed": 3}],
    ids=["rescaled", "own bath"],
)
def test_a_page_shows_the_equilibration_and_the_run_keeps_its_bits(sim, server, monkeypatch, asked):
    for name, value in (("APART", 0.0), ("SHARE", 1e9), ("FEWER", np.inf)):
        monkeypatch.setattr(live, name, value)
    sent: list[tuple[str, Any]] = []
    monkeypatch.setattr(server.feed, "_send", lambda kind, content: sent.append((kind, content)))
    monkeypatch.setattr(server.feed, "_listened", lambda: True)
    sim.followers.append(server.feed)
    sim.equilibrate(steps=100, **asked)
    frames = [content for kind, content in sent if kind == "frame"]
    steps = np.concatenate([unpacked(each["steps"]) for each in frames])
    times = np.concatenate([unpacked(each["times"]) for each in frames])
    assert len(set(steps)) > 3
    assert steps.tolist() == sorted(steps)
    assert -100 < steps[0] < steps[-1] == 0
    np.testing.assert_allclose(times, 0.001 * steps, atol=1e-15)
    told = [content["text"] for kind, content in sent if kind == "told"]
    assert told[-1].startswith("equilibrating · step 100 of 100")
    assert "end" not in [kind for kind, _ in sent]
    box, places = np.diag(sim.system.box.matrix), [restored(unpacked(each["positions"]))[0].T for each in frames]
    off = places[-1] - sim.state.positions / box
    assert np.abs(off - np.round(off)).max() < 2e-5
    assert np.abs(places[-1] - places[0]).max() > 1e-3
    sim.run(20)
    assert unpacked(sent[-2][1]["steps"]).tolist() == [20]
    alone = kd.Simulation(liquid(), dt=0.001)
    alone.equilibrate(steps=100, **asked)
    alone.run(20)
    np.testing.assert_array_equal(alone.state.phase, sim.state.phase)


def test_bodies_keep_their_rows_when_others_leave():
    system = liquid()
    state = system.state
    kept = np.array([0, 2, 63])
    left = kd.State(state.phase[..., kept], state.masses[kept], kept, state.box, 0.0, 0)
    x, _, held = phase_of(Stage.of(system), left)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(x[:, 0])), kept)
    np.testing.assert_array_equal(np.flatnonzero(held), kept)
    fewer = kd.System(left.positions, box=state.box, forces=()).at(left.phase, 0.0, ids=kept)
    np.testing.assert_array_equal(phase_of(Stage.of(fewer), left)[0], left.positions)


def test_a_run_that_nobody_watches_makes_no_frames(sim, server, monkeypatch):
    sent: list[str] = []
    monkeypatch.setattr(server.feed, "_send", lambda kind, content: sent.append(kind))
    sim.followers.append(server.feed)
    sim.run(20)
    assert sent == []


def test_a_slow_page_gets_the_newest_frame_alone(server):
    with server.reading(0) as reader:
        for step in range(3):
            server.send("told", {"step": step})
            server.send("frame", {"count": step})
        kinds = [(kind, json.loads(text)) for kind, text in reader.take()]
    assert [kind for kind, _ in kinds] == ["told", "told", "told", "frame"]
    assert kinds[-1][1] == {"count": 2}


def test_too_many_pages_are_refused(server):
    held = [server.reading(0) for _ in range(MOST_PAGES)]
    for each in held:
        assert each.__enter__() is not None
    assert asked(server, f"/events?token={server.token}")[0] == 503
    for each in held:
        each.__exit__(None, None, None)


def test_run_serves_the_page_and_says_its_address(sim, capsys):
    seen: list[int] = []

    def look(sim: kd.Simulation) -> None:
        if not seen:
            port, token = re.search(r"127\.0\.0\.1:(\d+)/\?token=(\S+)", capsys.readouterr().err).groups()  # type: ignore[union-attr]
            there = http.client.HTTPConnection("127.0.0.1", int(port), timeout=30)
            there.request("GET", f"/?token={token}")
            seen.append(there.getresponse().status)
            there.close()

    sim.run(10, observe=look, live=True)
    assert seen == [200]
    assert sim.followers == []


@pytest.mark.parametrize(("given", "why"), [(70000, "a port is"), (-1, "expected True"), ("x", "expected True")])
def test_a_port_that_is_none_is_refused(sim, given, why):
    with pytest.raises(kd.InputError, match=f"live: {why}"):
        sim.run(2, live=given)


def test_a_taken_port_and_a_problem_are_one_line(sim):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(kd.InputError, match=f"live: port {port} of 127.0.0.1: .*; give another port"):
            sim.run(2, live=port)
    with pytest.raises(kd.InputError, match="a Problem has no particles"):
        kd.Simulation(kd.load("ode-harmonic")).run(2, live=True)


def test_connections_without_the_token_do_not_shut_out_the_page(sim, monkeypatch):
    monkeypatch.setattr(serving, "MOST_CALLS", 2)
    server = Server(sim)
    events: list[tuple[str, Any]] = []
    reader = heard(server, 0, events)
    idle = [socket.create_connection(("127.0.0.1", server.port), timeout=30) for _ in range(5)]
    try:
        for each in idle[-2:]:
            each.sendall(b"GET / HTTP/1.1\r\nHost:")
        assert asked(server, f"/?token={server.token}")[0] == 200
        assert [each.recv(1) for each in idle[:3]] == [b""] * 3, "the oldest give way"
        server.send("end", {})
        reader.join(30)
        assert events == [("end", {})], "a page with the token stays"
    finally:
        for each in idle:
            each.close()
        server.close()


def test_more_connections_than_threads_are_closed_unheard(sim, monkeypatch):
    monkeypatch.setattr(serving, "MOST_THREADS", 0)
    server = Server(sim)
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as there:
        assert there.recv(1) == b""
    server.close()


def test_a_request_has_to_come_whole_within_its_time_and_length(sim, monkeypatch):
    monkeypatch.setattr(serving, "HEARD", 0.2)
    server = Server(sim)
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as slow:
        closed = threading.Event()

        def drip() -> None:
            with suppress(OSError):
                while not closed.wait(0.02):
                    slow.sendall(b"x")

        thread = threading.Thread(target=drip, daemon=True)
        thread.start()
        with suppress(ConnectionError):
            assert slow.recv(1) == b""
        closed.set()
        thread.join(30)
    monkeypatch.setattr(serving, "HEARD", 30.0)
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as long, suppress(ConnectionError):
        long.sendall(b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 99 + b"B: " + b"x" * 60_000 + b"\r\n")
        long.sendall(b"C: " + b"x" * 60_000 + b"\r\n")
        assert long.recv(1) == b""
    server.close()


def test_an_address_that_cannot_be_read_is_refused(server):
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as there:
        there.sendall(f"GET http://[x/?token={server.token} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        assert b" 400 " in there.recv(64)
