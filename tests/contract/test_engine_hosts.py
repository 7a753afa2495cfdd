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
from kickdrift.engines import hosts as other_machines
from kickdrift.engines import lammps_processes
from kickdrift_validation.performance.scaling_engine import two_namespaces, way_there

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
    ("# nothing\n", " names no machine"),
    (None, " cannot be read: No such file or directory"),
])  # fmt: skip
def test_bad_hosts_files(lines, said, tmp_path):
    hosts = tmp_path / "hosts"
    if lines is not None:
        hosts.write_text(lines)
    with pytest.raises(kd.InputError, match=f"^hosts: {re.escape(str(hosts) + said)}$"):
        kd.Simulation(kd.load("lj-1000"), **HOW, hosts=hosts)


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
