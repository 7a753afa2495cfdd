"""Run files of version 0.1.0 open, continue as version 0.1.0 did, and can be exported.

`tests/data/v0.1.0/make.py` made these files.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.jit.compile import processor

OLD = Path(__file__).parents[1] / "data" / "v0.1.0"
ENDS = np.load(OLD / "ends.npz")
STEPS = {"adaptive": 30, "liquid": 40, "liquid-mixed": 40, "meeting": 150, "planets": 50}
# Version 0.2.0 rounds the forces of a mixture differently, so that threads change no bit. It also rounds the Kepler
# series differently, whose errors had a common sign. Other files keep their bits.
ROUNDED = {"liquid": 1e-12, "liquid-mixed": 5e-6, "planets": 1e-12}


def test_every_file_is_tried():
    assert sorted(STEPS) == sorted(path.stem for path in OLD.glob("*.h5md"))


@pytest.fixture(params=STEPS)
def old(request, tmp_path):
    """A copy of a file of version 0.1.0."""
    return Path(shutil.copy(OLD / f"{request.param}.h5md", tmp_path))


def test_an_old_file_opens_and_is_shown(old, kickdrift):
    run = kd.open(old)
    assert run.steps[0] == 0
    assert run.steps[-1] == STEPS[old.stem]
    assert np.isfinite(run[-1].positions).all()
    assert len(run.system()) == run[-1].positions.shape[0]
    for more in ([], ["--all"]):
        status, out, _ = kickdrift("info", old, *more)
        assert status == 0
        assert ("0.1.0" in out) == bool(more)
        assert ("energy error" in out) != bool(more)
        assert "damaged" not in out


def test_an_old_file_is_resumed(old):
    sim = kd.resume(old)
    same_processor = kd.open(old).method["processor"] == processor()
    sim.run(STEPS[old.stem])
    found, expected = sim.state.phase, ENDS[f"{old.stem}/phase"]
    if same_processor and old.stem not in ROUNDED:
        assert found.tobytes() == expected.tobytes()
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDED.get(old.stem, 1e-9))
    assert sim.energy().total == pytest.approx(float(ENDS[f"{old.stem}/energy"]), abs=1e-5)
    assert kd.open(old).steps[-1] == sim.state.steps_done


def test_an_old_file_is_exported(old, kickdrift, tmp_path):
    for suffix in ("xyz", "dcd", "extxyz"):
        status, _, err = kickdrift("export", old, tmp_path / f"out.{suffix}")
        assert status == 0, err
        assert (tmp_path / f"out.{suffix}").stat().st_size > 0
