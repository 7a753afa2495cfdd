"""The page of the first hour: five tasks for each kind of user, none with more lines than its peer.

``test_docs.py`` runs the page's Python and its commands. LAMMPS' lines run here.
"""

from __future__ import annotations

import re

import pytest

from kickdrift.forces.external.lammps_library import lammps_class
from tests import pages
from tests.folders import DOCS

PAGE = DOCS / "first-hour.md"
TEXT = PAGE.read_text(encoding="utf-8")
PEERS = {"SciPy", "rebound", "ASE", "LAMMPS"}


def kinds() -> dict[str, dict[str, str]]:
    """Text of each task, by kind of user and by the task's heading."""
    parts = re.split(r"^## (.+)$", TEXT, flags=re.MULTILINE)[1:]
    found = {}
    for kind, part in zip(parts[::2], parts[1::2], strict=True):
        tasks = re.split(r"^### (.+)$", part, flags=re.MULTILINE)[1:]
        found[kind] = dict(zip(tasks[::2], tasks[1::2], strict=True))
    return {kind: tasks for kind, tasks in found.items() if tasks}


TASKS = {name: task for tasks in kinds().values() for name, task in tasks.items()}


def lines(code: str) -> int:
    """Lines of code, without blank lines and comments."""
    return sum(bool(line.strip()) and not line.lstrip().startswith("#") for line in code.splitlines())


def sides(task: str) -> tuple[tuple[str, int], tuple[str, int]]:
    """Name and lines of code of a task's two blocks; the first line of each block is its name."""
    ours, theirs = (pages.Block(*found) for found in pages.BLOCK.findall(task))
    return tuple((block.code.splitlines()[0].removeprefix("# "), lines(block.code)) for block in (ours, theirs))


def test_five_tasks_for_each_of_four_kinds_of_user():
    assert [len(tasks) for tasks in kinds().values()] == [5, 5, 5, 5]
    assert len(TASKS) == 20


@pytest.mark.parametrize("name", TASKS)
def test_no_task_needs_more_lines_than_its_peer(name):
    (us, ours), (peer, theirs) = sides(TASKS[name])
    assert us == "kickdrift"
    assert peer in PEERS
    assert 0 < ours <= theirs
    assert f"| {name} | {ours} | {peer} | {theirs} |\n" in TEXT


def test_no_line_hides_another():
    """Neither side saves lines by semicolons or by lines longer than the repository's own."""
    for block in pages.blocks(PAGE):
        assert ";" not in block.code
        assert max(map(len, block.code.splitlines())) <= 120


@pytest.mark.long
@pytest.mark.parametrize("code", [block.code for block in pages.blocks(PAGE) if block.language == "lammps"])
def test_the_lines_of_lammps_run(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.lammps").write_text(code, encoding="utf-8")
    lammps = lammps_class()(cmdargs=["-screen", "none", "-log", "none"])
    try:
        lammps.file("in.lammps")
        assert lammps.get_natoms() == 1000
        assert lammps.extract_global("ntimestep") > 0
    finally:
        lammps.close()
