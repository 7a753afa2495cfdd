"""kickdrift where Python lacks the modules and flags of POSIX systems."""

import ast
from pathlib import Path

import kickdrift
from tests.processes import python

POSIX = {"fcntl", "resource", "pwd", "grp", "termios"}
BLOCKED = f"import sys; sys.modules.update(dict.fromkeys({sorted(POSIX)}))\n"
EVERY = """
import pkgutil, importlib, kickdrift
for each in pkgutil.walk_packages(kickdrift.__path__, "kickdrift."):
    if each.name.rpartition(".")[2] not in ("__main__", "widget", "lammps_worker"):
        try:
            importlib.import_module(each.name)
        except ImportError as error:
            assert error.name not in ("fcntl", "resource", "pwd", "grp", "termios"), each.name
"""
RUN = """
import kickdrift as kd, numpy as np, os
sim = kd.Simulation(kd.load("sun-jupiter"), dt=1.0)
sim.run(10, every=5, output="run.h5md")
with kd.open("run.h5md") as run:
    assert len(run) == 3
from kickdrift.disk.posix import lock, memory_limits, unsent
assert memory_limits() == [] and not unsent(0) and lock(0) is None
"""


def test_every_module_is_imported_without_posix():
    done = python(BLOCKED + EVERY)
    assert done.returncode == 0, done.stderr


def test_a_run_is_written_and_read_without_posix(tmp_path):
    done = python(BLOCKED + f"import os; os.chdir({str(tmp_path)!r})\n" + RUN)
    assert done.returncode == 0, done.stderr


def test_one_module_knows_posix():
    top = Path(kickdrift.__file__).parent
    found = set()
    for path in top.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if not any(name in text for name in POSIX):
            continue
        for node in ast.walk(ast.parse(text)):
            names = [each.name for each in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) else []
            found |= {path.name} if POSIX & {str(name).partition(".")[0] for name in names} else set()
    assert found == {"posix.py", "rebound_snapshot.py"}
