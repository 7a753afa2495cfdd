"""Data files of LAMMPS read as tables, against ASE's reader; and files that the tables leave to ASE."""

from __future__ import annotations

import numpy as np
import pytest

from kickdrift.errors import InputError
from kickdrift.model.starts import builders
from kickdrift.model.starts.builders import read_structure
from kickdrift.model.starts.lammps_data import STYLES, atom_table
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS

COUNT = 30
BEFORE = {"atomic": [], "charge": [0.25], "bond": [3], "angle": [3], "molecular": [3], "full": [3, -0.25]}


def text_of(style: str, images: bool = False, tilts: bool = False, comments: bool = False) -> str:
    """A data file with its atoms in a random order."""
    rng = np.random.default_rng(len(style))
    lines = ["made by a test", "", f"{COUNT} atoms  # of two types", "2 atom types", "-1 9.5 xlo xhi", "0 11.5 ylo yhi"]
    lines += ["0.25 12 zlo zhi", *(["1.5 -2.25 0.5 xy xz yz"] if tilts else []), "", "Masses", ""]
    lines += ["1 63.5 # Cu", "2 26.98 # Al"] if comments else ["1 63.5", "2 26.98"]
    lines += ["", f"Atoms # {style}", ""]
    for i in rng.permutation(COUNT):
        own = [*BEFORE[style]]
        own.insert(0 if style in ("atomic", "charge") else 1, 1 + i % 2)
        flags = rng.integers(-2, 3, 3).tolist() if images else []
        lines.append(" ".join(map(repr, [int(i) + 1, *map(float_or_int, own), *rng.uniform(0, 9, 3).tolist(), *flags])))
    lines += ["", "Velocities", ""]
    lines += [" ".join(map(repr, [int(i) + 1, *rng.normal(size=3).tolist()])) for i in rng.permutation(COUNT)]
    return "\n".join(lines) + "\n"


def float_or_int(value):
    return float(value) if isinstance(value, float) else int(value)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("more", [{}, {"images": True}, {"tilts": True, "images": True}, {"comments": True}], ids=str)
@pytest.mark.parametrize("units", ["lj", "metal"])
def test_tables_hold_what_ase_reads(style, more, units, tmp_path, monkeypatch):
    path = tmp_path / "atoms.data"
    path.write_text(text_of(style, **more), encoding="utf-8")
    assert atom_table(path, None) is not None
    found = read_structure(path, UNIT_SYSTEMS[units])
    monkeypatch.setattr(builders, "atom_table", lambda path, style: None)
    wanted = read_structure(path, UNIT_SYSTEMS[units])
    np.testing.assert_allclose(found.positions, wanted.positions, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.velocities, wanted.velocities, rtol=1e-14)
    np.testing.assert_allclose(found.masses, wanted.masses, rtol=1e-9)
    np.testing.assert_array_equal(found.edges, wanted.edges)
    assert (found.species, found.periodic) == (wanted.species, wanted.periodic)
    if style in ("charge", "full"):
        np.testing.assert_array_equal(found.charges, wanted.charges)
    else:
        assert found.charges is wanted.charges is None


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("30 atoms", "31 atoms"),
        lambda text: text.replace("Masses", "Atom Type Labels"),
        lambda text: text.replace("\n7 ", "\n8 "),
        lambda text: text.replace("\n7 ", "\nseven "),
        lambda text: text.replace("\n2 26.98", "\n3 26.98"),
        lambda text: text.replace("# atomic", "# sphere"),
        lambda text: text[: len(text) // 2],
    ],
    ids=["count", "labels", "two of one id", "a word", "no mass", "style", "cut"],
)
def test_files_that_are_no_such_tables_are_left_to_ase(change, tmp_path):
    path = tmp_path / "atoms.data"
    path.write_text(change(text_of("atomic")), encoding="utf-8")
    assert atom_table(path, None) is None


def test_a_damaged_file_is_one_line(tmp_path):
    path = tmp_path / "atoms.data"
    path.write_text(text_of("atomic").replace("\n7 ", "\nseven "), encoding="utf-8")
    with pytest.raises(InputError, match=r"ASE cannot read .*invalid literal"):
        read_structure(path, UNIT_SYSTEMS["lj"])
