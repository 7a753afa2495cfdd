"""Snapshots of AMUSE, NEMO and GADGET, as files of AMUSE 2024.6.0 and unsio 1.0.2 have them, and damaged ones."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.bridges.snapshots import amuse_unit
from kickdrift.cli.main import app
from kickdrift.errors import InputError
from kickdrift.model.units.unit_systems import AU, MSUN, YEAR
from tests.folders import TOP

FILES = TOP / "tests" / "data" / "snapshots"
SCALE = {"length": "1 pc", "mass": "1 Msun", "velocity": "1 km/s"}
PARSEC, SUN = 3.08567758128e16, 1.98892e30  # AMUSE's own
N = 20
_rng = np.random.default_rng(1)  # of the script that wrote the files
X, V, M = _rng.normal(size=(N, 3)), _rng.normal(size=(N, 3)), _rng.uniform(0.5, 2, N)


@pytest.mark.parametrize(
    ("name", "masses", "time", "digits"),
    [
        ("amuse-nbody.hdf5", M / M.sum(), 0.5, 0.0),
        ("amuse.nemo", M / M.sum(), 0.0, 0.0),
        ("unsio.nemo", M, 0.75, 2e-7),
    ],
)
def test_plain_numbers_stay_as_they_are(name, masses, time, digits):
    system = kd.load(FILES / name)
    assert (system.units.name, system.state.time, len(system)) == ("nbody", time, N)
    for found, expected in ((system.state.positions, X), (system.state.velocities, V), (system.state.masses, masses)):
        np.testing.assert_allclose(found, expected, rtol=digits, atol=digits)
    assert [force.name for force in system.forces] == ["gravity"]


def test_amuses_units_are_converted():
    system = kd.System.from_snapshot(FILES / "amuse-parsec.hdf5")
    assert system.units.name == "astro"
    np.testing.assert_allclose(system.state.positions * AU / PARSEC, X, rtol=1e-12)
    np.testing.assert_allclose(system.state.velocities * AU / YEAR / 1e3, V, rtol=1e-12)
    np.testing.assert_allclose(system.state.masses * MSUN / SUN, M, rtol=1e-9)
    assert kd.System.from_snapshot(FILES / "amuse-parsec.hdf5", units="si").state.masses[0] == pytest.approx(M[0] * SUN)


def test_gadgets_units_are_given():
    path = FILES / "unsio-gadget.hdf5"
    with pytest.raises(InputError, match=r"does not say its units; give scale = \{'length': '1 kpc'"):
        kd.load(path)
    system = kd.System.from_snapshot(path, scale=SCALE)
    assert set(system.species) == {"stars"}
    assert system.units.name == "astro"
    np.testing.assert_allclose(system.state.masses, M, rtol=1e-6)
    np.testing.assert_allclose(system.state.velocities * AU / YEAR / 1e3, V, rtol=1e-6)
    plain = kd.System.from_snapshot(path, units="nbody")
    np.testing.assert_allclose(plain.state.positions, X, rtol=1e-6)


def test_gadgets_header_has_units_and_masses(tmp_path):
    path = edited(tmp_path, lambda file: with_units(file))
    system = kd.load(path)
    kiloparsec = 3.0856775814913673e19 / AU
    np.testing.assert_allclose(system.state.positions / kiloparsec, X, rtol=1e-6)
    np.testing.assert_allclose(system.state.masses, 0.25 * 1.989e40 / MSUN, rtol=1e-9)


def with_units(file: Any) -> None:
    head = file["Header"].attrs
    head["UnitLength_in_cm"], head["UnitMass_in_g"], head["UnitVelocity_in_cm_per_s"] = (
        3.0856775814913673e21,
        1.989e43,
        1e5,
    )
    head["MassTable"] = [0, 0, 0, 0, 0.25, 0]
    del file["PartType4/Masses"]


def edited(folder: Path, change: Any, name: str = "unsio-gadget.hdf5") -> Path:
    path = folder / name
    shutil.copy(FILES / name, path)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def without(name: str) -> Any:
    return lambda file: file.pop(name)


def head(**values: Any) -> Any:
    return lambda file: file["Header"].attrs.update(values)


@pytest.mark.parametrize(
    ("change", "name", "expected"),
    [
        (without("PartType4/Masses"), "unsio-gadget.hdf5", "PartType4 has no masses"),
        (without("PartType4/Velocities"), "unsio-gadget.hdf5", "PartType4 has no velocities"),
        (head(Redshift=1.0), "unsio-gadget.hdf5", "is in comoving coordinates"),
        (head(NumFilesPerSnapshot=2), "unsio-gadget.hdf5", "is one of several files"),
        (without("data/0000000001/attributes/mass"), "amuse-parsec.hdf5", "has no masses"),
        (
            lambda file: file["data/0000000001/attributes/mass"].attrs.modify("units", "none"),
            "amuse-parsec.hdf5",
            "mass: expected a unit of AMUSE, got 'none'",
        ),
        (
            lambda file: file["data/0000000001/attributes/x"].attrs.modify("units", "system.get('S.I.').base('time')"),
            "amuse-parsec.hdf5",
            "x: expected a unit of length",
        ),
    ],
)
def test_incomplete_snapshots_are_refused_in_one_line(tmp_path, change, name, expected):
    path = edited(tmp_path, change, name)
    with pytest.raises(InputError, match=expected) as error:
        kd.System.from_snapshot(path, scale=SCALE if "gadget" in name else None)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["unsio.nemo", "amuse.nemo", "unsio-gadget.hdf5", "amuse-parsec.hdf5"])
def test_every_cut_of_a_file_is_refused(tmp_path, name):
    data, path = (FILES / name).read_bytes(), tmp_path / name
    for size in range(3, len(data), max(1, len(data) // 60)):
        path.write_bytes(data[:size])
        with pytest.raises(InputError):
            kd.System.from_snapshot(path, scale=SCALE if "gadget" in name else None)


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("amuse.nemo", {"units": "astro"}, "has no units; give scale"),
        ("amuse-parsec.hdf5", {"units": "nbody"}, "has units, and 'nbody' are plain numbers"),
        ("amuse-parsec.hdf5", {"scale": SCALE}, "scale: the file has units of its own"),
        ("unsio-gadget.hdf5", {"scale": {"length": "1 pc"}}, "scale: expected length, mass, and velocity or time"),
        ("unsio.nemo", {"snapshot": 3}, "snapshot: expected one from 0 to 0, or from the end, got 3"),
    ],
)
def test_wrong_arguments_are_refused(name, given, expected):
    with pytest.raises(InputError, match=expected):
        kd.System.from_snapshot(FILES / name, **given)


def test_the_command_line_takes_snapshots():
    done = CliRunner().invoke(app, ["cluster", str(FILES / "unsio.nemo")])
    assert done.exit_code == 0
    assert "unsio: 20 stars, 1 state" in done.output
    refused = CliRunner().invoke(app, ["cluster", str(FILES / "unsio-gadget.hdf5")])
    assert isinstance(refused.exception, InputError)
    assert "does not say its units" in str(refused.exception)


@pytest.mark.parametrize("text", ["", "2.0", "__import__('os')", "system.get('S.I.').base('mass') + 1", "9**9**9**9"])
def test_units_are_read_and_not_run(text):
    with pytest.raises(InputError, match="mass: expected a unit of AMUSE"):
        amuse_unit(text, "mass", {"mass": 1})
