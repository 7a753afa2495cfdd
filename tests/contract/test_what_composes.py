"""What goes with what: the page says what the registries say, and each cell that says yes runs."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from docs.studies.what_composes import (
    BEGIN,
    BOXES,
    END,
    REASONS,
    YES,
    cell,
    columns,
    forces,
    page,
    system_of,
    usual,
)
from kickdrift.errors import InputError
from tests.folders import TOP
from tests.long import shortened

NAMES = forces()
SHORT = ["lennard-jones", "harmonic-bond", "gravity", "harmonic-trap", "j2"]  # pairs, bonds, fields


@pytest.mark.long
def test_the_page_says_what_the_registries_say():
    written = (TOP / "docs" / "what-composes.md").read_text(encoding="utf-8")
    assert written.split(BEGIN)[1].split(END)[0].strip() == page()


def test_all_reasons_are_short_and_in_use():
    text = (TOP / "docs" / "what-composes.md").read_text(encoding="utf-8")
    for words in REASONS.values():
        assert len(words.split()) <= 6
        assert words in text


@pytest.mark.parametrize("name", shortened(NAMES, SHORT))
def test_each_cell_that_says_yes_runs(name):
    subjects = [usual(name)]
    for box in BOXES:
        try:
            subjects.append(system_of(name, box))
        except InputError:
            continue
    hard = name == "reflecting-wall" or subjects[0].constraints is not None  # neither is a force
    method = "velocity-verlet" if hard else "dormand-prince45"
    for system in subjects[1:]:
        assert np.isfinite(kd.Simulation(system, method, 0.001).energy().potential)
    for asked in columns().values():
        for title, ask in asked.items():
            made: list[kd.Simulation] = []
            if cell(lambda ask=ask, made=made: made.append(ask(subjects[0]))) != YES or made[0] is None:
                continue
            made[0].run(2)
            assert np.isfinite(made[0].state.phase).all(), title
