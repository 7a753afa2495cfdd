"""Exports and Universes, read back with MDAnalysis and ASE, against the written states."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import constants

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.trajectory.export import formats, to_mdanalysis
from tests.folders import DOCS
from tests.run_files import ANGSTROM, FRAMES, PS, REAL, UNITS, N, make_system, states, without, write

ase_io = pytest.importorskip("ase.io")
MDAnalysis = pytest.importorskip("MDAnalysis")
pytestmark = [  # of MDAnalysis, about its own readers
    pytest.mark.filterwarnings("ignore:DCDReader currently makes:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:Reader has no dt information:UserWarning"),
    pytest.mark.filterwarnings("ignore:1 A\\^3 CRYST1 record:UserWarning"),
    pytest.mark.filterwarnings("ignore:Unit cell dimensions not found:UserWarning"),
    pytest.mark.filterwarnings("ignore:Element information is missing:UserWarning"),
]

PAGE = (DOCS / "export.md").read_text(encoding="utf-8")
FLOAT32 = 3 * 2.0**-24  # three roundings: to float32, to nm for TRR, and back
READ_BY_MDANALYSIS = tuple(suffix for suffix, format in formats.FORMATS.items() if format.package == "MDAnalysis")
READ_BY_ASE = tuple(suffix for suffix, format in formats.FORMATS.items() if format.package == "ASE")


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "run.h5md"


# -- exports, read by their own programs


@pytest.mark.parametrize("unwrapped", [False, True])
@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("suffix", READ_BY_MDANALYSIS)
def test_mdanalysis_reads_what_was_exported(path, suffix, units, unwrapped):
    system = make_system(units)
    written = write(path, system)[1::2]
    target = path.with_suffix(suffix)
    done = kd.export(path, target, unwrapped=unwrapped, start=1, step=2)
    assert (done.path, done.frames, done.particles) == (target, len(written), N)
    nominal = units in ("lj", "nbody", "astro")
    off = {".xtc": 1e-4 if nominal else 1e-2, ".pdb": 5.1e-4}.get(suffix, 0)
    length, time = ANGSTROM.get(units, 1.0), PS.get(units, 1.0)
    with MDAnalysis.coordinates.core.reader(str(target), n_atoms=N) as found:
        assert len(found) == len(written)
        for ts, state in zip(found, written, strict=True):
            x = state.positions if unwrapped else state.wrapped()
            np.testing.assert_allclose(ts.positions, x * length, rtol=0 if off else FLOAT32, atol=off or 5.1e-9)
            if suffix == ".trr":
                np.testing.assert_allclose(ts.velocities, state.velocities * length / time, rtol=FLOAT32)
            else:
                assert not ts.has_velocities
            if suffix in (".dcd", ".xtc", ".trr"):
                assert ts.time == pytest.approx(state.time * time, rel=3e-7)
            if suffix in (".xtc", ".trr"):
                assert ts.data["step"] == state.steps_done
            if system.box.periodic and suffix != ".xyz":
                np.testing.assert_allclose(ts.dimensions, [15, 16, 17.5, 90, 90, 90], rtol=1e-6)
            else:
                assert ts.dimensions is None
    assert sorted(each.name for each in path.parent.iterdir() if "offsets" not in each.name) == sorted(
        [path.name, target.name]
    )
    if suffix in (".xyz", ".pdb"):
        names = list(MDAnalysis.Universe(str(target), to_guess=()).atoms.names)
        assert names[:3] == {
            (".xyz", True): ["body_0", "body_1", "body_2"], (".pdb", True): ["body"] * 3,
            (".xyz", False): [system.species[k] for k in system.species_index[:3]],
            (".pdb", False): [system.species[k] for k in system.species_index[:3]],
        }[suffix, bool(system.names)]  # fmt: skip


@pytest.mark.parametrize("unwrapped", [False, True])
@pytest.mark.parametrize("units", UNITS)
@pytest.mark.parametrize("suffix", READ_BY_ASE)
def test_ase_reads_what_was_exported(path, suffix, units, unwrapped):
    from ase.units import eV, kg, m
    from ase.units import s as second

    system = make_system(units)
    written = write(path, system)[:-1]
    kd.export(path, path.with_suffix(suffix), unwrapped=unwrapped, stop=-1)
    found = ase_io.read(path.with_suffix(suffix), ":")
    assert len(found) == len(written)
    # Value of a unit of length, time and mass in ASE's units, by ASE's own constants. Nominal numbers stay unchanged.
    length, time, mass = {
        "metal": (1e-10 * m, 1e-12 * second, constants.atomic_mass * kg),
        "real": (1e-10 * m, 1e-15 * second, constants.atomic_mass * kg),
        "gromacs": (1e-9 * m, 1e-12 * second, constants.atomic_mass * kg),
        "si": (m, second, kg),
    }.get(units, (1.0, 1.0, 1.0))
    exact = suffix == ".traj"
    rounded = {"rtol": 1e-13 if exact else 1e-12, "atol": 0 if exact else 5.1e-9}
    for atoms, state in zip(found, written, strict=True):
        x = state.positions if unwrapped else state.wrapped()
        np.testing.assert_allclose(atoms.positions, x * length, rtol=1e-14, atol=rounded["atol"])
        # ASE's constants are CODATA's of 2014, which changes times by 5e-9.
        np.testing.assert_allclose(atoms.get_velocities(), state.velocities * length / time, rtol=2e-8, atol=1e-8)
        np.testing.assert_allclose(atoms.get_masses(), state.masses * mass, rtol=1e-7)
        energy = 0.5 * np.sum(state.masses[:, None] * state.velocities**2) * mass * (length / time) ** 2
        assert atoms.get_kinetic_energy() / eV == pytest.approx(energy, rel=1e-6)
        assert (atoms.info["time"], atoms.info["time_unit"]) == (state.time, system.units.time)
        assert atoms.info["step"] == state.steps_done
        assert list(atoms.get_tags()) == system.species_index.tolist()
        assert atoms.info["species"] == list(system.species)
        assert atoms.info.get("names", []) == list(system.names)
        assert list(atoms.symbols[:2]) == (["Ar", "Kr"] if units in REAL else ["X", "X"])
        assert list(atoms.pbc) == [system.box.periodic] * 3
        if system.box.periodic:
            np.testing.assert_allclose(atoms.cell.lengths(), [15, 16, 17.5], rtol=1e-14)
        if not exact:
            np.testing.assert_allclose(atoms.arrays["velocities"], atoms.get_velocities(), atol=1e-8)


@pytest.mark.parametrize("suffix", [".dcd", ".trr", ".xyz"])
def test_a_removed_body_is_nan_where_the_format_has_a_place_for_each(path, suffix):
    system = make_system("nbody")
    first, last = states(system, (0, 20))
    write(path, system, [first, without(last, 4)], absorbed={4: -1})
    done = kd.export(path, path.with_suffix(suffix))
    assert any("removed are kept as NaN" in note for note in done.notes)
    with MDAnalysis.coordinates.core.reader(str(path.with_suffix(suffix))) as found:
        assert np.flatnonzero(np.isnan(found[1].positions).any(axis=1)).tolist() == [4]


@pytest.mark.parametrize("suffix", READ_BY_ASE)
def test_a_removed_body_is_left_out_for_ase(path, suffix):
    system = make_system("nbody")
    first, last = states(system, (0, 20))
    write(path, system, [first, without(last, 4)], absorbed={4: -1})
    done = kd.export(path, path.with_suffix(suffix))
    assert any("removed are left out" in note for note in done.notes)
    before, after = ase_io.read(path.with_suffix(suffix), ":")
    assert (len(before), len(after)) == (N, N - 1)
    assert "body 4" in before.info["names"]
    assert "body 4" not in after.info["names"]
    assert list(after.info["ids"]) == [k for k in range(N) if k != 4]
    np.testing.assert_allclose(after.positions, without(last, 4).positions, atol=1e-8)


@pytest.mark.parametrize("suffix", [".xtc", ".pdb"])
def test_a_removed_body_is_refused_where_there_is_no_nan(path, suffix):
    system = make_system("nbody")
    first, last = states(system, (0, 20))
    write(path, system, [first, without(last, 4)], absorbed={4: -1})
    with pytest.raises(InputError, match=r"frame 1 \(step 20\): body 4 was removed.*--stop 1 ends before"):
        kd.export(path, path.with_suffix(suffix))
    assert [each.name for each in path.parent.iterdir()] == ["run.h5md"]
    kd.export(path, path.with_suffix(suffix), stop=1)


# -- precision and limits


@pytest.mark.long
def test_xtc_of_reduced_units_is_near(tmp_path_factory):
    folder = tmp_path_factory.mktemp("xtc")

    @settings(max_examples=40, deadline=None)
    @given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 60), spread=st.floats(1e-3, 250))
    def holds(seed, n, spread):
        x = np.random.default_rng(seed).uniform(-spread, spread, (n, 3))
        system = System(x, box=(12.0, 9.0, 400.0))
        write(folder / "run.h5md", system, [system.state])
        for unwrapped in (False, True):
            kd.export(folder / "run.h5md", folder / "run.xtc", unwrapped=unwrapped, overwrite=True)
            with MDAnalysis.lib.formats.libmdaxdr.XTCFile(str(folder / "run.xtc")) as file:
                found = file.read().x.astype(float) * 10
            assert np.abs(found - (x if unwrapped else system.box.wrap(x))).max() <= 1e-4

    holds()


def test_xtc_too_coarse_for_a_far_particle_is_refused(path):
    x = np.zeros((30, 3))
    x[17] = 0, 3000.03, 0  # XTC is computed in float32, whose steps are 2.4e-4 here
    system = System(x, box=(10.0, 10.0, 10.0))
    write(path, system, [system.state])
    target = path.with_suffix(".xtc")
    with pytest.raises(InputError, match=r"frame 0 \(step 0\): particle 17: is off by .* more than 0.0001; without"):
        kd.export(path, target, unwrapped=True)
    assert not target.exists()
    kd.export(path, target)


@pytest.mark.parametrize("there", [3e5, -3e5])
def test_xtc_beyond_32_bits_is_refused(path, there):
    x = np.zeros((30, 3))
    x[5, 2] = there
    system = System(x)
    write(path, system, [system.state])
    with pytest.raises(InputError, match=r"particle 5: z = -?300000 is beyond the 32-bit integers of \.xtc; export to"):
        kd.export(path, path.with_suffix(".xtc"), unwrapped=True)
    kd.export(path, path.with_suffix(".trr"), unwrapped=True)


def test_xtc_spread_beyond_32_bits_is_refused(path):
    """libxdrfile stores differences from the lowest coordinate, and these must also fit."""
    x = np.zeros((30, 3))
    x[5, 2], x[7, 2] = 1.5e5, -1.5e5
    system = System(x)
    write(path, system, [system.state])
    with pytest.raises(InputError, match="beyond the 32-bit integers"):
        kd.export(path, path.with_suffix(".xtc"))


def test_pdb_refuses_what_its_columns_do_not_hold(path, monkeypatch):
    x = np.zeros((30, 3))
    x[5, 1] = -1000.0
    system = System(x)
    write(path, system, [system.state])
    with pytest.raises(InputError, match=r"particle 5: y = -1000 is beyond the columns of \.pdb; export to"):
        kd.export(path, path.with_suffix(".pdb"))
    for value, fits in ((-999.99949, False), (-999.999, True), (9999.9996, False), (9999.999, True)):
        edge = System(np.full((1, 3), value))
        write(path, edge, [edge.state])
        if fits:
            kd.export(path, path.with_suffix(".pdb"), overwrite=True)
        else:
            with pytest.raises(InputError, match=r"columns of \.pdb"):
                kd.export(path, path.with_suffix(".pdb"), overwrite=True)
    path.with_suffix(".pdb").unlink()
    many = System(np.zeros((100_000, 3)))
    write(path, many, [many.state])
    with pytest.raises(InputError, match=r"has 100,000 particles; \.pdb holds at most 99,999"):
        kd.export(path, path.with_suffix(".pdb"))
    wide = System(np.zeros((3, 3)), box=(1e5, 10, 10))
    write(path, wide, [wide.state])
    with pytest.raises(InputError, match="edge of 100000"):
        kd.export(path, path.with_suffix(".pdb"))
    system = make_system("lj")
    write(path, system)
    monkeypatch.setattr(to_mdanalysis.Pdb, "MODELS", 2)
    with pytest.raises(InputError, match=r"5 frames; \.pdb holds at most 2; try --step 3"):
        kd.export(path, path.with_suffix(".pdb"))
    kd.export(path, path.with_suffix(".pdb"), step=3)


def test_dcd_says_that_frames_are_uneven(path):
    system = make_system("lj")
    write(path, system, states(system, (0, 20, 40, 70)))
    done = kd.export(path, path.with_suffix(".dcd"))
    assert any("not evenly spaced" in note for note in done.notes)
    even = kd.export(path, path.with_suffix(".dcd"), stop=3, overwrite=True)
    assert not any("spaced" in note for note in even.notes)


def test_dcd_whose_first_time_is_no_whole_step(path):
    system = make_system("lj")
    late = [
        State(s.phase, s.masses, s.ids, s.box, s.time + 0.0123, s.steps_done) for s in states(system)
    ]  # as after an equilibration
    write(path, system, late)
    done = kd.export(path, path.with_suffix(".dcd"))
    assert any("since the first frame" in note for note in done.notes)
    with MDAnalysis.coordinates.core.reader(str(path.with_suffix(".dcd"))) as found:
        assert [ts.time for ts in found] == pytest.approx(0.1 * np.arange(FRAMES), abs=1e-6)


@pytest.mark.parametrize("suffix", [".xtc", ".trr"])
def test_steps_beyond_32_bits_become_frame_numbers(path, suffix):
    system = make_system("lj")
    write(path, system, [State(s.phase, s.masses, s.ids, s.box, s.time, s.steps_done * 10**9) for s in states(system)])
    done = kd.export(path, path.with_suffix(suffix))
    assert any("beyond 32 bits" in note for note in done.notes)
    with MDAnalysis.coordinates.core.reader(str(path.with_suffix(suffix))) as found:
        assert [ts.data["step"] for ts in found] == list(range(FRAMES))


# -- files and words


@pytest.mark.parametrize("suffix", formats.FORMATS)
def test_nothing_is_overwritten_unasked(path, suffix):
    write(path, make_system("lj"))
    target = path.with_suffix(suffix)
    target.write_text("precious")
    with pytest.raises(InputError, match="exists already; pass --overwrite"):
        kd.export(path, target)
    assert target.read_text() == "precious"
    with pytest.raises(InputError, match="no such file"):
        kd.export(path.with_name("none.h5md"), target.with_name(f"new{suffix}"), overwrite=True)
    with pytest.raises(InputError, match="is not an export that kickdrift wrote; it is not replaced"):
        kd.export(path, target, overwrite=True)
    assert target.read_text() == "precious"
    target.unlink()
    kd.export(path, target)
    kd.export(path, target, overwrite=True)
    assert target.read_bytes()[:8] != b"precious"
    assert sorted(each.name for each in path.parent.iterdir()) == sorted(["run.h5md", target.name])


@pytest.mark.parametrize("suffix", formats.FORMATS)
def test_a_stopped_export_leaves_nothing(path, suffix):
    write(path, make_system("lj"))

    def stop(done, of):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kd.export(path, path.with_suffix(suffix), progress=stop)
    assert [each.name for each in path.parent.iterdir()] == ["run.h5md"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_full_disk_leaves_nothing(path):
    """A limit on file sizes stands in for the full disk: writes beyond it fail in the same way."""
    write(path, make_system("lj", n=900))
    code = """
import resource, signal, sys
sys.dont_write_bytecode = True  # which the limit would cut
import kickdrift as kd
from kickdrift.trajectory.export.formats import FORMATS
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (7000, 7000))
for suffix in FORMATS:
    try:
        kd.export(sys.argv[1], sys.argv[1].replace(".h5md", suffix))
    except kd.RunError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) == len(formats.FORMATS)
    assert [each.name for each in path.parent.iterdir()] == ["run.h5md"]


@pytest.mark.parametrize(
    ("output", "options", "message"),
    [
        ("out.foo", {}, r"the name of an export must end in \.dcd, \.xtc.*\.data"),
        ("out", {}, "must end in"),
        ("out.h5md", {}, "must end in"),
        ("nowhere/out.xyz", {}, "there is no folder"),
        ("out.xyz", {"start": 5}, "has 5 frames, none of them in start:stop"),
        ("out.xyz", {"step": 0}, "step: expected a whole number"),
        ("out.xyz", {"step": -1}, "step: expected a whole number"),
    ],
)
def test_bad_input(path, output, options, message):
    write(path, make_system("lj"))
    with pytest.raises(InputError, match=message):
        kd.export(path, path.parent / output, **options)
    assert [each.name for each in path.parent.iterdir()] == ["run.h5md"]


@pytest.mark.parametrize(
    ("package", "suffix", "extra"),
    [
        ("MDAnalysis", ".dcd", "mdanalysis"),
        ("ase", ".traj", "ase"),
        ("ase", ".extxyz", "ase"),
        ("rebound", ".bin", "rebound"),
    ],
)
def test_a_missing_package_is_named(path, monkeypatch, package, suffix, extra):
    write(path, make_system("lj"))
    for name in [each for each in sys.modules if each.split(".")[0] == package]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"{suffix} needs .*: pip install 'kickdrift\[{extra}\]'"):
        kd.export(path, path.with_suffix(suffix))


@pytest.mark.parametrize("suffix", formats.FORMATS)
def test_the_command_says_once_what_is_lost(path, suffix, monkeypatch, kickdrift):
    write(path, make_system("lj"))
    monkeypatch.chdir(path.parent)
    words = ("export", path.name, f"out{suffix}")
    code, out, err = kickdrift(*words, "--step", 2)
    count = "1 frame" if formats.FORMATS[suffix].single else "3 frames"
    assert (code, out) == (0, f"out{suffix}: {count} of 12 particles\n")
    (line,) = err.splitlines()
    assert line.startswith(formats.losses(formats.FORMATS[suffix], nominal=True))
    units = {
        "MDAnalysis": "; sigma and tau stand as",
        "ASE": "; sigma, m and epsilon stand as angstrom, u and eV",
    }
    package = formats.FORMATS[suffix].package
    assert f"positions are inside the box{units.get(package, '')}" in line
    code, out, err = kickdrift(*words)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    done = kickdrift(*words, "--overwrite", "--quiet", "--unwrapped", "--start", "-1")
    assert done == (0, f"out{suffix}: 1 frame of 12 particles\n", "")


@pytest.mark.parametrize("suffix", [".trr", ".traj"])
def test_stored_images_and_compression_change_nothing(path, suffix):
    written = write(path, make_system("lj"), write=("images",), compress=True)
    for unwrapped in (True, False):
        target = path.with_name(f"{unwrapped}{suffix}")
        kd.export(path, target, unwrapped=unwrapped)
        if suffix == ".traj":
            found = [atoms.positions for atoms in ase_io.read(target, ":")]
        else:
            with MDAnalysis.coordinates.core.reader(str(target)) as reader:
                found = [ts.positions.copy() for ts in reader]
        for x, state in zip(found, written, strict=True):
            np.testing.assert_allclose(x, state.positions if unwrapped else state.wrapped(), rtol=FLOAT32)


def test_progress_goes_to_the_end(path):
    write(path, make_system("lj"))
    seen = []
    kd.export(path, path.with_suffix(".trr"), progress=lambda done, of: seen.append((done, of)))
    assert seen == [(k, FRAMES) for k in range(1, FRAMES + 1)]


def test_blocks_of_frames_are_read_in_order(path, monkeypatch):
    from kickdrift.trajectory.export import formats

    system = make_system("lj", n=3)
    written = write(path, system, states(system, range(0, 101)))
    monkeypatch.setattr(formats, "BLOCK_FRAMES", 7)
    for step in (1, 3, 9):
        kd.export(path, path.with_suffix(".traj"), unwrapped=True, start=2, step=step, overwrite=True)
        found = ase_io.read(path.with_suffix(".traj"), ":")
        assert [atoms.info["step"] for atoms in found] == list(range(2, 101, step))
        for atoms, state in zip(found, written[2::step], strict=True):
            np.testing.assert_array_equal(atoms.positions, state.positions)


# -- the page


def test_the_page_shows_the_table_of_formats():
    shown = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.splitlines() if line.startswith("|")]
    heading, _, *rows = shown
    assert [heading, *rows] == formats.table()


def test_the_python_of_the_page_runs(path, monkeypatch, capsys):
    monkeypatch.chdir(path.parent)
    write(path, make_system("lj"))
    blocks = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    names: dict = {"__name__": "page"}
    exec(compile("\n".join(blocks), "docs/export.md", "exec"), names)
    names["universe"].trajectory.close()
    shown = capsys.readouterr().out.splitlines()
    assert shown[0] == "5 frames, 0.1 from one to the next"
    assert shown[-1] == f"3 frames; {formats.losses(formats.FORMATS['.trr'], nominal=True)}"


def test_species_in_reduced_units_are_no_elements(tmp_path):
    """A and B of a mixture are X with their names, not X and boron."""
    mixture = kd.LennardJones(cutoff=2.0, truncation="shift")
    system = kd.System(np.eye(3), box=[5.0] * 3, forces=[mixture], species=["A", "B", "B"])
    kd.Simulation(system, dt=0.001).run(2, output=tmp_path / "run.h5md")
    kd.export(tmp_path / "run.h5md", tmp_path / "run.extxyz")
    atoms = pytest.importorskip("ase.io").read(tmp_path / "run.extxyz", index=-1)
    for found in (atoms, system.to_ase()):
        assert found.get_chemical_symbols() == ["X"] * 3
        again = kd.System.from_ase(found, forces=[mixture], units="lj")
        assert [again.species[k] for k in again.species_index] == ["A", "B", "B"]
    assert atoms.arrays["kind"].tolist() == ["A", "B", "B"]
