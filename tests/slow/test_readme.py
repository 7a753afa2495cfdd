"""The Python code of the README and of the pages runs as it stands; the system file on the page of orbits loads."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from tests.folders import TOP

README = TOP / "README.md"
BRIDGES = README.parent / "docs" / "bridges.md"


def run_python_of(page: Path) -> dict:
    """Run a page's blocks of Python, one after the other, and return the names that they define."""
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    names: dict = {"__name__": page.stem.lower()}
    exec(compile("\n".join(blocks), str(page), "exec"), names)
    return names


def test_the_python_of_the_readme_runs(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_python_of(README)
    report = names["report"]
    assert capsys.readouterr().out.startswith(str(report.energy.rms_relative_error))
    assert report.energy.verdict == "bounded"
    assert abs(report.temperature - 1.0) < 0.05


def test_the_system_of_the_page_on_orbits_loads(tmp_path):
    page = README.parent / "docs" / "orbits.md"
    text, *_ = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "orbits.toml").write_text(text, encoding="utf-8")
    system = kd.load(tmp_path / "orbits.toml")
    assert system.names == ("Star", "b", "c", "comet", "dust 1", "dust 2")
    np.testing.assert_allclose(system.radii[:3] * 149597870.7, [600000.0, 70000.0, 0.0], rtol=1e-12)  # AU in km
    assert len(system.events) == 4
    assert np.abs(system.state.masses @ system.state.positions).max() < 1e-15


def test_the_python_of_the_page_on_bridges_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_python_of(BRIDGES)
    assert names["some"].times.tolist() == [0.04, 0.12, 0.2]
    assert len(names["table"]) == len(names["run"]) == 11


@pytest.mark.long
def test_the_python_of_the_page_on_observables_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_python_of(README.parent / "docs" / "observables.md")
    einstein, green_kubo = names["einstein"], names["green_kubo"]
    # The fluid is at T* = 0.9, rho* = 0.8442; the error needs a run of twenty units of time.
    assert einstein.value == pytest.approx(green_kubo.value, abs=4 * (einstein.error + green_kubo.error))
    assert np.isfinite(einstein.error)
    assert names["p"].pressure == pytest.approx(float(names["mean"].value), abs=5 * names["p"].pressure_error)
    assert names["rdf"].g.max() > 2.5
    assert names["s"].s.max() > 2.0
