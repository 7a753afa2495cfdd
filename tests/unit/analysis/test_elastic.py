"""Elastic constants: published ones of silicon, Cauchy's relation and pressure of pairs, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts.builders import lattice
from kickdrift.systemfile.files import shipped


def crystal(force, kind: str, sites: int, edge: float, **given) -> kd.System:
    x, edges = lattice(kind, sites * 8, sites / edge**3)
    return kd.System(x, box=edges, forces=[force], **given)


@pytest.mark.long
def test_silicon_has_its_published_constants():
    """Stillinger-Weber silicon at 5.431 angstrom, relaxed: Balamane et al. 1992, doi:10.1103/PhysRevB.46.2250; without
    relaxation C44 would be 117 GPa."""
    system = crystal(kd.StillingerWeber(), "diamond", 8, 5.431, masses=28.0855, units="metal", species=["Si"] * 64)
    found = kd.analysis.elastic_constants(system)
    np.testing.assert_allclose(np.array(found.cubic) / found.gigapascal, [151.4, 76.4, 56.4], atol=0.1)
    assert found.bulk == pytest.approx((found.cubic[0] + 2 * found.cubic[1]) / 3, rel=1e-9)
    assert found.error.max() < 0.02 * found.gigapascal
    assert np.abs(found.matrix - found.matrix.T).max() < 1e-3 * found.gigapascal
    assert "GPa" in str(found)
    assert found.as_json()["strain"] == 1e-3


@pytest.mark.long
def test_the_copper_with_a_smooth_end_has_its_constants_at_small_strains():
    """Lattice constant and cohesive energy of Zhou, Johnson & Wadley 2004, and the elastic constants by LAMMPS' own
    stress, 169.68, 122.14 and 75.74 GPa (docs/crystals.md)."""
    path = shipped()["copper-864"].with_name("Cu_zhou2004_smooth.eam.alloy")
    x, edges = lattice("fcc", 256, 4 / 3.615**3)
    given = {"masses": 63.546, "units": "metal", "species": ["Cu"] * 256}
    system = kd.System(x, box=edges, forces=[kd.EmbeddedAtom(str(path))], **given)
    found = kd.analysis.elastic_constants(system, 1e-4)
    np.testing.assert_allclose(np.array(found.cubic) / found.gigapascal, [169.68, 122.14, 75.74], atol=0.02)
    assert abs(found.pressure) < 0.01 * found.gigapascal
    assert kd.Simulation(system, "velocity-verlet", 0.001).energy().potential / 256 == pytest.approx(-3.54, abs=1e-3)


def test_pairs_keep_cauchys_relation_under_pressure():
    """For central forces between sites of inversion, C12 - C44 is twice the pressure (Born & Huang 1954)."""
    system = crystal(kd.LennardJones(cutoff=1.45, truncation="switch"), "fcc", 4, 1.5)
    found = kd.analysis.elastic_constants(system, 2e-3)
    c11, c12, c44 = found.cubic
    pressure = kd.Simulation(system, "velocity-verlet", 0.001).sample().pressure
    assert found.pressure == pytest.approx(pressure, rel=1e-8)
    assert c12 - c44 == pytest.approx(2.0 * pressure, rel=1e-3)
    assert found.gigapascal is None
    assert c11 > c12


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: (kd.load("kepler-e09"), 1e-3), "elastic_constants: needs a box that is periodic along all three axes"),
        (lambda: (kd.load("copper-864"), 0.2), "elastic_constants: strain must be at most 0.05, got 0.2"),
        (lambda: (kd.load("copper-864").with_forces(kd.HarmonicTrap(1.0)), 1e-3), "force 'harmonic-trap' acts from"),
    ],
)
def test_what_has_no_elastic_constants_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        kd.analysis.elastic_constants(*make())


@pytest.mark.long
def test_the_command_measures_a_relaxed_crystal(kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    silicon = crystal(kd.StillingerWeber(), "diamond", 8, 5.431, masses=28.0855, units="metal", species=["Si"] * 64)
    (tmp_path / "si.toml").write_text(silicon.to_toml())
    code, out, _ = kickdrift("relax", "si.toml", "--strain", 1e-3, "--json", "found.json", "--quiet")
    assert code == 0
    assert "elastic constants, GPa" in out
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["converged"]
    assert np.array(found["elastic"]["matrix"])[0, 0] * 160.2176634 == pytest.approx(151.4, abs=0.1)
    code, _, err = kickdrift("relax", "kepler-e09", "--strain", 1e-3)
    assert code == 2
    assert "needs a box that is periodic along all three axes" in err
