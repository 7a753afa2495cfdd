"""Runs that stream by IMD, read by imdclient and MDAnalysis, which we did not write."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.model.units import constants
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.run.watchers import imd
from kickdrift.run.watchers.imd_client import Frame, Kind, Units, greeting, head, packets
from tests.systems import liquid

imdclient = pytest.importorskip("imdclient.IMDClient")


class Port:
    """A free port, and the moment from which a run listens there."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.number = int(probe.getsockname()[1])
        self.open, before = threading.Event(), imd.listening

        def listening(*given: Any) -> socket.socket:
            found = before(*given)
            self.open.set()
            return found

        monkeypatch.setattr(imd, "listening", listening)

    def wait(self) -> int:
        assert self.open.wait(60)
        return self.number


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Port:
    kd.Simulation(liquid(), dt=0.001).run(2)  # compiles, since a client waits 5 s for a greeting
    return Port(monkeypatch)


def in_thread(port: Port, work: Callable[[], Any]) -> Callable[[], Any]:
    """Start the work; the returned function waits for its end and returns what it made. A failure ends the run."""
    found: list[Any] = []

    def go() -> None:
        try:
            found.append(work())
        except BaseException as error:
            found.append(error)
            with suppress(OSError), socket.create_connection(("127.0.0.1", port.number), timeout=5) as last:
                kill(last)

    thread = threading.Thread(target=go, daemon=True)
    thread.start()

    def result() -> Any:
        thread.join(60)
        assert not thread.is_alive()
        if isinstance(found[0], BaseException):
            raise found[0]
        return found[0]

    return result


def kill(client: socket.socket) -> None:
    """End the run, and read what it still sends: unread bytes would cut the connection before the word is read."""
    client.sendall(head(Kind.KILL, 0))
    while client.recv(65536):
        pass


def client_of(port: Port, n: int) -> Any:
    return imdclient.IMDClient("127.0.0.1", port.wait(), n, multithreaded=False)


def test_mdanalysis_reads_every_look_and_the_run_keeps_its_bits(port):
    mda = pytest.importorskip("MDAnalysis", "2.10")
    system = liquid()

    def read() -> list[Any]:
        universe = mda.Universe.empty(len(system))
        universe.load_new(f"imd://127.0.0.1:{port.wait()}", multithreaded=False)
        steps = universe.trajectory
        return [(ts.data["step"], ts.time, ts.copy(), dict(ts.data)) for ts in steps]

    def see(sim: kd.Simulation) -> None:
        looks.append((sim.state, sim.forces(), sim.energy()))

    reader, looks = in_thread(port, read), []
    sim = kd.Simulation(system, dt=0.001)
    sim.run(20, every=5, observe=see, imd=port.number, imd_wait=True)
    frames = reader()
    assert [step for step, *_ in frames] == [0, 5, 10, 15, 20]
    for (state, forces, energies), (_, now, ts, data) in zip(looks, frames, strict=True):
        assert now == state.time
        np.testing.assert_array_equal(ts.positions, state.positions.astype("f4"))
        np.testing.assert_array_equal(ts.velocities, state.velocities.astype("f4"))
        np.testing.assert_allclose(ts.forces, forces, rtol=1e-5, atol=1e-5 * np.abs(forces).max())
        np.testing.assert_allclose(ts.dimensions, [*np.diag(system.box.matrix), 90, 90, 90], rtol=1e-6)
        assert data["total_energy"] == pytest.approx(energies.total, rel=1e-6)
        assert data["potential_energy"] == pytest.approx(energies.potential, rel=1e-6)
        assert data["dt"] == 0.001
    alone = kd.Simulation(system, dt=0.001)
    alone.run(20, every=5)
    np.testing.assert_array_equal(alone.state.phase, sim.state.phase)


def test_a_client_pauses_thins_and_ends_the_run(port, tmp_path):
    system, done = liquid(), []

    def command() -> list[int]:
        client = client_of(port, len(system))
        seen = [client.get_imdframe().step]
        client._conn.sendall(head(Kind.PAUSE, 0) + head(Kind.TRATE, 20))
        time.sleep(0.2)
        before = len(done)
        time.sleep(0.2)
        assert len(done) == before, "a paused run goes on"
        client._conn.sendall(head(Kind.RESUME, 0))
        seen += [client.get_imdframe().step for _ in range(4)]
        client._conn.sendall(head(Kind.KILL, 0))
        with suppress(EOFError):
            while True:
                client.get_imdframe()
        return seen

    commands = in_thread(port, command)
    sim = kd.Simulation(system, dt=0.001)
    path = tmp_path / "run.h5md"
    report = sim.run(
        10**6, every=5, observe=lambda sim: done.append(sim.steps_done), imd=port.number, imd_wait=True, output=path
    )
    seen = commands()
    assert np.all(np.diff(seen)[1:] == 20), "a frame each 20 steps"
    assert sim.stopped == report.stopped == "by the IMD client"
    assert sim.steps_done < 10**6
    with kd.open(path) as run:
        assert run.closed
        assert run.steps[-1] == sim.steps_done
    assert "; stopped by the IMD client" in CliRunner().invoke(app, ["info", str(path)]).stdout
    sim.run(2)
    assert sim.stopped == ""


def test_a_run_outlives_clients_that_go_or_speak_another_language(port):
    system = liquid()

    def visit() -> None:
        for words in (b"GET / HTTP/1.1\r\n\r\n", head(Kind.MDCOMM, 10**9), head(Kind.GO, 0)[:5]):
            with socket.create_connection(("127.0.0.1", port.wait()), timeout=10) as stranger:
                stranger.sendall(words)
                with suppress(ConnectionError):  # dropped
                    while stranger.recv(4096) and len(words) > 5:
                        pass
        client = client_of(port, len(system))
        client.get_imdframe()
        client._conn.sendall(head(Kind.MDCOMM, 1) + b"\0" * 16 + head(Kind.TRATE, 1000) + head(Kind.WAIT, 0))
        before, step = 0, 0
        while step - before < 1000:
            before, step = step, client.get_imdframe().step
        client.stop()
        with client_of(port, len(system))._conn as last:
            kill(last)

    visits = in_thread(port, visit)
    sim = kd.Simulation(system, dt=0.001)
    report = sim.run(10**6, every=2, imd=port.number, imd_wait=True)
    visits()
    assert any("does not apply" in each for each in report.warnings)
    assert report.stopped == "by the IMD client"


def test_real_units_become_angstrom_ps_and_kilojoule_per_mole():
    per_mol = constants.AVOGADRO / 1000
    assert Units.of(UNIT_SYSTEMS["lj"]) == Units.of(UNIT_SYSTEMS["astro"]) == (1.0, 1.0, 1.0)
    assert Units.of(UNIT_SYSTEMS["metal"]) == pytest.approx((1.0, 1.0, 96.4853321))
    assert Units.of(UNIT_SYSTEMS["si"]) == pytest.approx((1e10, 1e12, per_mol))
    vectors = np.ones((1, 3))
    frame = Frame(1e-15, 2e-12, 5, 300.0, 2.0, 1.0, None, 1e-10 * vectors, 1e2 * vectors, vectors)
    sent = np.frombuffer(packets(frame, Units.of(UNIT_SYSTEMS["si"]))[-12:], "f4")
    np.testing.assert_allclose(sent, per_mol * 1e-10, rtol=1e-6)


@pytest.mark.parametrize("given", [0, 70000, "x", True])
def test_a_port_that_is_none_is_refused(given):
    with pytest.raises(kd.InputError, match="imd"):
        kd.Simulation(liquid(), dt=0.001).run(2, imd=given)


def test_a_taken_port_is_one_line_and_nothing_is_written(tmp_path):
    path = tmp_path / "run.h5md"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(kd.InputError, match=f"imd: port {port} of 127.0.0.1: .*; give another port"):
            kd.Simulation(liquid(), dt=0.001).run(2, imd=port, output=path)
    assert not path.exists()
    with pytest.raises(kd.InputError, match="a Problem has no particles"):
        kd.Simulation(kd.load("ode-harmonic")).run(2, imd=port)


class Visitor:
    """A program that connects at the first look of a run, says some words, and leaves at a later look if it has to."""

    def __init__(self, port: Port, words: bytes, leaves: bool = False, narrow: bool = False) -> None:
        self.port, self.words, self.leaves, self.narrow = port, words, leaves, narrow
        self.line = socket.socket()
        self.came = False

    def __call__(self, sim: kd.Simulation) -> None:
        if not self.came:
            self.came = True
            if self.narrow:
                self.line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            self.line.connect(("127.0.0.1", self.port.number))
            self.line.sendall(self.words)
        elif self.leaves and sim.steps_done == 10:
            self.line.close()

    def heard(self) -> int:
        """Number of bytes that came until the end."""
        with self.line:
            return sum(iter(lambda: len(self.line.recv(65536)), 0))


@pytest.mark.parametrize(
    ("words", "leaves", "frames"),
    [
        (head(Kind.GO, 0) + head(Kind.WAIT, 1), True, None),  # the wish to wait ends with its connection
        (head(Kind.GO, 0) + head(Kind.PAUSE, 0)[:3], False, 20),  # the rest of the packet does not come
        (head(Kind.MDCOMM, 64) + b"\0" * 100, False, 0),
        (b"\0\0\0", False, 0),
    ],
    ids=["wait", "half a command", "half of the forces", "no go"],
)
def test_a_program_that_goes_or_says_half_a_word_holds_up_nothing(port, words, leaves, frames):
    visitor = Visitor(port, words, leaves)
    sim = kd.Simulation(liquid(), dt=0.001)
    sim.run(20, every=1, observe=visitor, imd=port.number)
    assert sim.steps_done == 20
    if frames is not None:
        frame = len(packets(Frame(*[0] * 6, np.eye(3), *[np.zeros((64, 3))] * 3), Units()))  # type: ignore[arg-type]
        assert visitor.heard() == len(greeting(True)) + frames * frame


def test_a_program_that_never_reads_misses_frames_and_does_not_stop_the_run(port, monkeypatch):
    monkeypatch.setattr(imd, "LINGER", 0.01)
    before = imd.packets
    monkeypatch.setattr(imd, "packets", lambda *given: before(*given) * 4000)  # more than the system's buffers take
    visitor = Visitor(port, head(Kind.GO, 0), narrow=True)
    report = kd.Simulation(liquid(), dt=0.001).run(20, every=1, observe=visitor, imd=port.number)
    visitor.line.close()
    assert report.stopped == ""
    assert any("the IMD client was slow and missed" in each for each in report.warnings)


def test_a_run_waits_for_a_slow_reader_if_it_has_to_but_not_for_ever(port, monkeypatch, capsys):
    monkeypatch.setattr(imd, "PATIENCE", 0.05)
    monkeypatch.setattr(imd, "SHORT", 0.0)
    monkeypatch.setattr(imd, "POLL", 1e-3)
    before = imd.packets
    monkeypatch.setattr(imd, "packets", lambda *given: before(*given) * 4000)
    visitor = Visitor(port, head(Kind.GO, 0) + head(Kind.WAIT, 1), narrow=True)
    report = kd.Simulation(liquid(), dt=0.001).run(20, every=1, observe=visitor, imd=port.number)
    visitor.line.close()
    assert report.steps == 20
    said = capsys.readouterr().err
    assert "imd: the run waits: the program that reads is slow\nimd: the run goes on\n" in said


def test_the_terminal_says_that_a_run_waits(port, monkeypatch, capsys):
    monkeypatch.setattr(imd, "SHORT", 0.0)
    heard = threading.Event()
    before = imd.notice

    def notice(text: str) -> None:
        before(text)
        heard.set()

    monkeypatch.setattr(imd, "notice", notice)

    def come() -> None:
        assert heard.wait(60)
        with socket.create_connection(("127.0.0.1", port.number), timeout=10) as line:
            heard.clear()
            line.sendall(head(Kind.PAUSE, 0) + head(Kind.GO, 0))
            assert heard.wait(60)
            kill(line)

    comes = in_thread(port, come)
    kd.Simulation(liquid(), dt=0.001).run(20, every=1, imd=port.number, imd_wait=True)
    comes()
    said = capsys.readouterr().err
    assert "imd: the run waits: no program reads\n" in said
    assert "imd: the run waits: the program that reads has paused it\n" in said
