"""The worked tasks of CONTRIBUTING.md, applied to a copy of the source: they work, with the stated numbers of lines."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import pages
from tests.folders import TOP

PAGE = TOP / "CONTRIBUTING.md"
TASKS = re.split(r"^### \d\. ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
LINES = re.compile(r"^\*\*Lines: (\d+)\*\*", flags=re.MULTILINE)

CHECK = """
import runpy
import sys

import numpy as np

import kickdrift as kd
from kickdrift.systemfile.files import shipped

assert kd.__file__.startswith(sys.argv[1]), kd.__file__
trapped = kd.System([[0.1, 0.0, 0.0]], forces=[kd.GaussianTrap(depth=2.0, width=1.0)])
for name in ("suzuki4", "heun3"):
    assert kd.Simulation(trapped, name, dt=0.01).run(100).energy.max_relative_error < 1e-6, name

start = kd.load("lj-1000").state
liquid = kd.System(start.positions, start.velocities, box=start.box, forces=[kd.Mie14(cutoff=2.5, truncation="switch")])
sim = kd.Simulation(liquid, dt=0.001)
assert sim.run(20, every=10, output="liquid.h5md").energy.max_relative_error < 1e-4
speeds = np.linalg.norm(sim.state.velocities, axis=1)
with kd.open("liquid.h5md") as run:
    assert run.unit_of("largest_speed") == "sigma/tau"
    np.testing.assert_allclose(run.observables["largest_speed"][-1], speeds.max(), rtol=1e-14)
kd.export("liquid.h5md", "liquid.csv", unwrapped=True)
table = np.genfromtxt("liquid.csv", delimiter=",", skip_header=1)
np.testing.assert_array_equal(table[-1000:, 3:6], sim.state.positions)

system = kd.load(shipped()["lagrange-triangle"])
triangle = kd.Simulation(system, "suzuki4", dt=system.invariants["period"] / 400)
triangle.run(400)
assert np.abs(triangle.state.positions - system.state.positions).max() < 1e-5
"""


def apply(block: pages.Block, folder: Path) -> None:
    """Edit the file of a block, or write it. Each hunk of a diff must fit in one place."""
    path = folder / block.title
    if block.language != "diff":
        assert not path.exists(), block.title
        path.write_text(block.code, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    for hunk in block.code.split("@@\n"):
        lines = hunk.splitlines(keepends=True)
        assert {line[0] for line in lines} <= set(" +-"), f"{block.title}: {hunk}"
        before = "".join(line[1:] for line in lines if line[0] != "+")
        after = "".join(line[1:] for line in lines if line[0] != "-")
        places = [found.start() for found in re.finditer(f"^{re.escape(before)}", text, re.MULTILINE)]
        assert len(places) == 1, f"{block.title} has not exactly one place for:\n{hunk}"
        text = text[: places[0]] + after + text[places[0] + len(before) :]
    path.write_text(text, encoding="utf-8")


def blocks_of(task: str, folder: Path) -> list[pages.Block]:
    page = folder / "task.md"
    page.write_text(task, encoding="utf-8")
    return [block for block in pages.blocks(page) if block.title]


def added(block: pages.Block) -> int:
    lines = block.code.splitlines()
    return len(lines) if block.language != "diff" else sum(line.startswith("+") for line in lines)


def test_there_are_seven_tasks():
    assert len(TASKS) == 7


@pytest.mark.parametrize("task", TASKS, ids=[task.splitlines()[0] for task in TASKS])
def test_a_task_costs_the_lines_that_it_states(task, tmp_path):
    parts = LINES.split(task)[1:]
    assert parts, "no number of lines"
    for stated, part in zip(parts[::2], parts[1::2], strict=True):
        assert sum(map(added, blocks_of(part, tmp_path))) == int(stated)


@pytest.mark.long
def test_the_tasks_work(tmp_path):
    """All seven tasks in one copy of the source. The user's own column runs as the page shows it."""
    copy = tmp_path / "copy"
    for name in ("src", "systems", "validation", "docs", "tests"):
        skip = shutil.ignore_patterns("__pycache__", "*.png", "data")
        shutil.copytree(TOP / name, copy / name, ignore=skip)
    for task in TASKS:
        for block in blocks_of(task, tmp_path):
            apply(block, copy)
    path = os.pathsep.join([str(copy / "src"), str(copy / "validation")])
    for command in (["-c", CHECK, str(copy)], [str(copy / "species_energy.py")]):
        done = subprocess.run(
            [sys.executable, "-W", "error", *command], cwd=tmp_path, env=os.environ | {"PYTHONPATH": path},
            capture_output=True, text=True, timeout=600, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr


def test_a_block_that_fits_nowhere_is_noticed(tmp_path):
    (tmp_path / "a.py").write_text("one\ntwo\ntwo\n", encoding="utf-8")
    apply(pages.Block("diff", "a.py", " one\n+and\n"), tmp_path)
    assert (tmp_path / "a.py").read_text(encoding="utf-8") == "one\nand\ntwo\ntwo\n"
    for hunk in (" two\n+and\n", " three\n+and\n"):
        with pytest.raises(AssertionError, match="has not exactly one place"):
            apply(pages.Block("diff", "a.py", hunk), tmp_path)
