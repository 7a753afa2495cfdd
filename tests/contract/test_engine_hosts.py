"""An engine's processes on other machines: the hosts file, the connections, and a run on two network namespaces."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
from multiprocessing import AuthenticationError

import pytest

import kickdrift as kd
from docs.studies.scaling_engine import two_namespaces, way_there
from kickdrift.engines import hosts as other_machines
from kickdrift.engines import lammps_processes

HOW = {"engine": "lammps", "integrator": "velocity-verlet"}


def test_a_hosts_file_gives_the_processes_and_a_resumed_run_takes_one_again(monkeypatch, tmp_path):
    """127.0.0.2 is this machine, but mpiexec takes it for another."""
    monkeypatch.setenv("HYDRA_LAUNCHER_EXEC", str(way_there(tmp_path)))
    hosts, path, system = tmp_path / "hosts", tmp_path / "run.h5md", kd.load("lj-1000")
    hosts.write_text("127.0.0.1  # this machine\n127.0.0.2:1\n")
    sim = kd.Simulation(system, **HOW, hosts=hosts)
    report = sim.run(10, output=path)
    assert report.processes == 2
    assert sim.integration.stepper._session._world._key is not None  # the processes came over the network
    sim.integration.stepper._session.close()
    assert report.energy.final == pytest.approx(kd.Simulation(system, **HOW).run(10).energy.final, rel=1e-12)
    sim = kd.resume(path, hosts=hosts)
    sim.run(10)
    assert (sim.processes, sim.steps_done) == (2, 20)
    sim.integration.stepper._session.close()


def test_a_process_from_elsewhere_proves_that_it_knows_the_key():
    key, taken = bytes(range(other_machines.KEY_BYTES)), []
    with other_machines.listening("127.0.0.1", 3) as door:
        where = "{}:{}".format(*door.getsockname())
        for theirs in (key, key[::-1]):
            here = threading.Thread(target=lambda: taken.append(other_machines.accepted(door.accept()[0], key)))
            here.start()
            if theirs == key:
                there = other_machines.connected(where, theirs)
            else:
                with pytest.raises((AuthenticationError, OSError, EOFError)):
                    other_machines.connected(where, theirs)
            here.join()
    taken[0].send("word")
    assert (there.recv(), taken[1]) == ("word", None)
    there.close()
    taken[0].close()


@pytest.mark.parametrize(("lines", "said"), [
    ("a b c", ", line 1: 'a b c' is not NAME or NAME:COUNT"),
    ("one\ntwo:0", ", line 2: 'two:0' is not NAME or NAME:COUNT"),
    ("# nothing\n", ": names no machine"),
    (None, ": no such file"),
    ("\xff", ": is not a text file"),
    ("localhost:999999", ", line 1: 'localhost' has 999,999 processes; a machine takes 1,024"),
    ("localhost:1000\none\nlocalhost:25", ", line 3: 'localhost' has 1,025 processes; a machine takes 1,024"),
    ("a:1024\nb:1024\nc:1024\nd:1024\ne", ", line 5: more than 4,096 processes, which is the limit for a run"),
    ("#" * 2**20 + "\n", ": too large: a hosts file has at most 1,048,576 bytes"),
])  # fmt: skip
def test_bad_hosts_files(lines, said, tmp_path):
    hosts = tmp_path / "hosts"
    if lines is not None:
        hosts.write_text(lines, encoding="latin-1")
    with pytest.raises(kd.InputError, match=f"^hosts: {re.escape(str(hosts) + said)}$"):
        kd.Simulation(kd.load("lj-1000"), **HOW, hosts=hosts)


@pytest.mark.parametrize("path", ["pipe", "/dev/zero", "/dev/null"])
def test_a_hosts_file_is_a_regular_file(path, tmp_path, monkeypatch):
    """A pipe would wait for ever, and a device may have no end."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    with pytest.raises(kd.InputError, match=rf"^hosts: {path}: is a (pipe|device), not a hosts file$"):
        kd.Simulation(kd.load("lj-1000"), **HOW, hosts=path)


def test_the_processes_of_this_machine_have_room_in_its_memory(tmp_path):
    """All lines with this machine's names count together, and so does more than the lines list."""
    hosts = tmp_path / "hosts"
    for lines, processes in [("localhost:900\n127.0.0.1:900", None), ("localhost", 1000)]:
        hosts.write_text(lines)
        with pytest.raises(kd.InputError, match=r"^run: 1,[08]00 processes take about .* of memory; give fewer$"):
            kd.Simulation(kd.load("lj-1000"), **HOW, hosts=hosts, processes=processes)
    for processes, said in [
        (2000, r"2,000 would run on 'localhost'; a machine takes 1,024"),
        (5000, r"5,000 are more than 4,096, which is the limit for a run"),
    ]:
        with pytest.raises(kd.InputError, match=f"^processes: {said}$"):
            kd.Simulation(kd.load("lj-1000"), **HOW, hosts=hosts, processes=processes)


@pytest.mark.parametrize(("hosts", "count", "here"), [
    ({"localhost": 2, "192.0.2.1": 4}, 6, 2),
    ({"localhost": 2, "192.0.2.1": 4}, 1, 1),
    ({"192.0.2.1": 4, "localhost": 2}, 5, 1),
    ({"192.0.2.1": 4, "127.0.0.2": 2}, 13, 4),
])  # fmt: skip
def test_the_share_of_this_machine(hosts, count, here):
    """192.0.2.1 is in nobody's network (RFC 5737)."""
    assert other_machines.on_this_machine(hosts, count) == here


def test_machines_that_cannot_be_reached_and_engines_without_processes(tmp_path):
    hosts = tmp_path / "hosts"
    hosts.write_text("255.255.255.255")
    with pytest.raises(kd.InputError, match=r"^hosts: machine '255\.255\.255\.255' cannot be reached: "):
        kd.Simulation(kd.load("lj-1000"), **HOW, hosts=hosts).run(1)
    with pytest.raises(kd.InputError, match=r"^engine 'native': hosts: native runs on this machine alone; only lammps"):
        kd.Simulation(kd.load("lj-1000"), hosts=hosts)


@pytest.mark.parametrize(("said", "cause"), [
    (
        "ssh: connect to host node2 port 22: Connection refused\n"
        "[mpiexec@node1] ui_cmd_cb (/src/mpiexec/pmiserv_pmci.c:51): Launch proxy failed.\n"
        "[mpiexec@node1] main (/src/mpiexec/mpiexec.c:270): process manager error waiting for completion",
        "ssh: connect to host node2 port 22: Connection refused",
    ),
    (
        "[mpiexec@node1] HYDU_create_process (/src/launch.c:7): execvp error on file /ssh (No such file or directory)\n"
        "[mpiexec@node1] main (/src/mpiexec/mpiexec.c:270): process manager error waiting for completion",
        "execvp error on file /ssh (No such file or directory)",
    ),
    (
        "Warning: Permanently added 'node2' to the list of known hosts.\nTraceback (most recent call last):\n"
        "ModuleNotFoundError: No module named 'kickdrift'\n"
        "[mpiexec@node1] main (/src/mpiexec/mpiexec.c:270): process manager error waiting for completion",
        "ModuleNotFoundError: No module named 'kickdrift'",
    ),
])  # fmt: skip
def test_processes_that_do_not_start_say_why(said, cause, monkeypatch, tmp_path):
    """The lines are those of MPICH 5.0.2."""
    program = tmp_path / "mpiexec"
    program.write_text(f"#!/bin/sh\ncat >&2 <<'END'\n{said}\nEND\nexit 255\n")
    program.chmod(0o700)
    monkeypatch.setattr(lammps_processes, "mpiexec", lambda: program)
    with pytest.raises(RuntimeError, match=f"^mpiexec ended with status 255: {re.escape(cause)}$"):
        lammps_processes.Processes(2)


PARENT = """
import sys
from kickdrift.engines import lammps_processes
lammps_processes.mpiexec = lambda: sys.argv[1]
lammps_processes.Processes(2)
"""


def test_mpiexec_ends_with_a_parent_that_is_killed(tmp_path):
    """In mpiexec's place is a program that says something when it begins, and when it ends by itself."""
    program, said = tmp_path / "mpiexec", tmp_path / "said"
    os.mkfifo(said)
    work = "    print('begun', file=file, flush=True)\n    time.sleep(60)\n    file.write('late')\n"
    program.write_text(f"#!{sys.executable} -IS\nimport time\nwith open({str(said)!r}, 'w') as file:\n{work}")
    program.chmod(0o700)
    with subprocess.Popen([sys.executable, "-c", PARENT, program]) as parent, open(said) as file:
        assert file.readline() == "begun\n"
        parent.kill()
        assert file.read() == ""


@pytest.mark.long
@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("ip"), reason="needs root and the command ip")
def test_a_run_on_two_network_namespaces(tmp_path):
    """Two namespaces share no address: all connections go over a virtual cable, as between two machines."""
    with two_namespaces(tmp_path, there=2) as (before, more):
        ran = subprocess.run(
            [*before, sys.executable, "-m", "kickdrift", "run", "lj-1000", "--engine", "lammps", "--hosts",
             str(tmp_path / "hosts"), "--steps", "20"],
            capture_output=True, text=True, env={**os.environ, **more},
        )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    assert "in 3 processes" in ran.stdout
