"""Which modules know that the edges of a box may lean: the box itself, the pair list, bonds, and files."""

from __future__ import annotations

import io
import tokenize
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd

PACKAGE = Path(kd.__file__).parent
WORDS = {"triclinic", "leans", "leaning_image", "square_by_edges"}
KNOW = {
    "model/box/box.py", "model/box/cell.py", "model/nearness.py", "forces/lists/pairlist.py",
    "forces/lists/load.py", "trajectory/layout/edges.py", "systemfile/writing.py", "forces/bonded/kernel.py",
    "forces/charges/far_kernel.py", "forces/seam/arguments.py", "engines/cuda/__init__.py",
    "forces/external/lammps_host.py",
}  # fmt: skip
VOLUME = 4.0 * 3.0 * 9.0  # of the leaning box below; its c x a is (0, 36, 2)


def names(path: Path) -> set[str]:
    """The names in a source that has one of the words, without its texts and comments."""
    text = path.read_text(encoding="utf-8")
    if not any(word in text for word in WORDS):
        return set()
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {token.string for token in tokens if token.type == tokenize.NAME}


def test_only_the_box_the_list_and_the_files_know_that_edges_lean():
    found = {str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if names(path) & WORDS}
    assert found == KNOW


@pytest.mark.parametrize(
    ("box", "tilts", "narrowest"),
    [
        (kd.Box((4.0, 5.0, 6.0)), (), ("shortest box edge", 4.0)),
        (kd.Box((4.0, 5.0, 6.0), periodic=(False, True, True)), (), ("shortest box edge", 5.0)),
        (kd.Box(), (), ("shortest box edge", np.inf)),
        (
            kd.Box(matrix=[[4.0, 0, 0], [2.0, 3.0, 0], [1.0, -0.5, 9.0]]),
            (2.0, 1.0, -0.5),
            ("smallest height of the box", VOLUME / np.hypot(36.0, 2.0)),
        ),
    ],
)
def test_what_others_ask_a_box(box, tilts, narrowest):
    assert box.tilts == tilts
    assert box.narrowest == (narrowest[0], pytest.approx(narrowest[1], rel=1e-14))
