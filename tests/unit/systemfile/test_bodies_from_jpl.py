"""Bodies from JPL: recorded answers of Horizons, a small SPK kernel, the record of a run, and what is refused."""

from __future__ import annotations

import struct
import sys
from types import ModuleType

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts.horizons import OBLIQUITY
from kickdrift.model.units.unit_systems import AU

CERES = {
    "targetname": "1 Ceres (A801 AA)", "x": 2.02, "y": -1.97, "z": -0.43, "vx": 0.0064, "vy": 0.0069, "vz": -0.00096,
}  # fmt: skip
AMBIGUOUS = """Ambiguous target name; provide unique id:
  ID#      Name                               Designation  IAU/aliases/other
  -------  ---------------------------------- -----------  -------------------
        4  Mars Barycenter
      499  Mars
"""
SUN = {"name": "Sun", "mass": 1.0}


def answering(monkeypatch, answer):
    """A package astroquery that gives this answer, or raises it; returns what it was asked."""
    asked = {}

    class Horizons:
        def __init__(self, **given):
            asked.update(given)

        def vectors(self, **given):
            asked.update(given)
            if isinstance(answer, Exception):
                raise answer
            return [answer]

    module = ModuleType("astroquery.jplhorizons")
    module.Horizons = Horizons
    monkeypatch.setitem(sys.modules, "astroquery", ModuleType("astroquery"))
    monkeypatch.setitem(sys.modules, "astroquery.jplhorizons", module)
    return asked


def ceres(**given):
    return {"name": "Ceres", "mass": 4.7e-10, "horizons": "1;", "date": "2025-01-01T00:00", **given}


def test_a_body_by_name_and_the_record_of_a_run(monkeypatch, tmp_path):
    asked = answering(monkeypatch, CERES)
    system = kd.System.from_elements([SUN, ceres()])
    assert asked == {"id": "1;", "location": "500@10", "epochs": 2460676.5, "refplane": "ecliptic"}
    apart = system["Ceres"].position - system["Sun"].position
    np.testing.assert_allclose(apart, [2.02, -1.97, -0.43], rtol=1e-12)
    moving = system["Ceres"].velocity - system["Sun"].velocity
    np.testing.assert_allclose(moving, np.array([0.0064, 0.0069, -0.00096]) * 365.25, rtol=1e-12)
    said = "Ceres: JPL Horizons, 1 Ceres (A801 AA): 2025-01-01T00:00 TDB (Julian date 2460676.5), ecliptic of J2000, "
    assert system.ephemerides == (said + "origin 10",)
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(2, output=tmp_path / "run.h5md")
    with kd.open(tmp_path / "run.h5md") as run:
        assert run.system_record["ephemerides"] == [said + "origin 10"]
    del sim
    assert kd.resume(tmp_path / "run.h5md").system.ephemerides == system.ephemerides


def test_a_system_file_has_its_own_units(monkeypatch, tmp_path):
    answering(monkeypatch, CERES)
    path = tmp_path / "ceres.toml"
    path.write_text(
        'units = "si"\n[particles]\ncentral = {name = "Sun", mass = "1 Msun"}\n'
        'elements = [{name = "Ceres", mass = 0.0, horizons = "1;", date = "2025-01-01", plane = "equator"}]\n'
        '[[force]]\ntype = "gravity"\n'
    )
    system = kd.load(path)
    apart = system["Ceres"].position - system["Sun"].position
    np.testing.assert_allclose(apart, np.array([2.02, -1.97, -0.43]) * AU, rtol=1e-12)
    assert "equator of the ICRF" in system.ephemerides[0]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (ValueError(AMBIGUOUS), "'1;' names several bodies, give the number of one: 4 Mars Barycenter; 499 Mars$"),
        (ValueError("Unknown target (nobody). Maybe try different id_type?"), "'1;': Unknown target"),
        (ConnectionError("Max retries exceeded\nwith url"), r"no answer from JPL \(ConnectionError\); without a netw"),
    ],
)
def test_horizons_without_a_state(monkeypatch, answer, message):
    answering(monkeypatch, answer)
    with pytest.raises(InputError, match=rf"^bodies\[1\] \(Ceres\).horizons: {message}") as error:
        kd.System.from_elements([SUN, ceres()])
    assert "\n" not in str(error.value)


def test_packages_that_are_missing_are_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "astroquery.jplhorizons", None)
    with pytest.raises(InputError, match=r"needs astroquery: pip install 'kickdrift\[sky\]'"):
        kd.System.from_elements([SUN, ceres()])
    monkeypatch.setitem(sys.modules, "jplephem.spk", None)
    with pytest.raises(InputError, match=r"needs jplephem: pip install 'kickdrift\[sky\]'"):
        kd.System.from_elements([SUN, from_spk(tmp_path / "none.bsp")])


# --- kernels ---


def kernel(path, segments):
    """Write an SPK kernel with segments (target, centre, position at J2000 and its change a day in km), which hold from
    J2000 to 100 days later as Chebyshev polynomials of degree 1 (NAIF, SPK required reading, type 2)."""
    length = 100 * 86400.0
    word, summaries, data = 385, b"", b""
    for target, centre, x, v in segments:
        middle = length / 2
        rows = [value for k in range(3) for value in (x[k] + v[k] * 50.0, v[k] * 50.0)]
        numbers = [middle, middle, *rows, 0.0, length, 8.0, 1.0]
        data += struct.pack(f"<{len(numbers)}d", *numbers)
        summaries += struct.pack("<2d6i", 0.0, length, target, centre, 1, 2, word, word + len(numbers) - 1)
        word += len(numbers)
    ends = b"FTPSTR:\r:\n:\r\n:\r\x00:\x81:\x10\xce:ENDFTP"
    head = struct.pack("<8s2i60s3i8s603s28s297s", b"DAF/SPK ", 2, 6, b"test".ljust(60), 2, 2, word, b"LTL-IEEE",
                       b"", ends, b"")  # fmt: skip
    table = struct.pack("<3d", 0.0, 0.0, float(len(segments))) + summaries
    path.write_bytes(head + table.ljust(1024, b"\0") + b" " * 1024 + data)
    return path


def from_spk(path, **given):
    return {"name": "rock", "mass": 0.0, "spk": str(path), "target": 2000001, "date": 2451555.0, **given}


@pytest.fixture
def rocks(tmp_path):
    pytest.importorskip("jplephem")
    sun, rock = ((1e5, 2e5, 3e5), (10.0, 20.0, 30.0)), ((4e8, 1e8, 5e7), (1e6, -2e6, 3e5))
    return kernel(tmp_path / "rocks.bsp", [(10, 0, *sun), (2000001, 0, *rock), (2000002, 2000001, *sun)])


def test_a_body_from_a_kernel(rocks):
    system = kd.System.from_elements([SUN, from_spk(rocks, plane="equator")])
    apart = system["rock"].position - system["Sun"].position
    wanted = np.array([4e8 - 1e5 + 1e7 - 100.0, 1e8 - 2e5 - 2e7 - 200.0, 5e7 - 3e5 + 3e6 - 300.0])
    np.testing.assert_allclose(apart, wanted * 1e3 / AU, rtol=1e-12)
    moving = system["rock"].velocity - system["Sun"].velocity
    np.testing.assert_allclose(moving, np.array([1e6 - 10.0, -2e6 - 20.0, 3e5 - 30.0]) * 1e3 / AU * 365.25, rtol=1e-12)
    assert system.ephemerides[0].startswith("rock: rocks.bsp, 2000001: 2000-01-11T12:00 TDB")
    turned = kd.System.from_elements([SUN, from_spk(rocks)])
    ecliptic = turned["rock"].position - turned["Sun"].position
    c, s = np.cos(OBLIQUITY), np.sin(OBLIQUITY)
    np.testing.assert_allclose(ecliptic, [apart[0], c * apart[1] + s * apart[2], c * apart[2] - s * apart[1]])


def test_the_last_segment_of_a_body_counts(tmp_path):
    """As in SPICE, where a later segment has precedence."""
    pytest.importorskip("jplephem")
    still = (0.0, 0.0, 0.0)
    old, new = ((1e8, 0.0, 0.0), still), ((2e8, 0.0, 0.0), still)
    path = kernel(tmp_path / "twice.bsp", [(10, 0, still, still), (2000001, 0, *old), (2000001, 0, *new)])
    system = kd.System.from_elements([SUN, from_spk(path, plane="equator")])
    apart = system["rock"].position - system["Sun"].position
    np.testing.assert_allclose(apart, [2e11 / AU, 0.0, 0.0], rtol=1e-12)


def test_a_kernel_whose_records_form_a_circle_is_refused(rocks):
    data = bytearray(rocks.read_bytes())
    data[1024:1032] = struct.pack("<d", 2.0)  # the record after the only one is this one
    rocks.write_bytes(data)
    with pytest.raises(InputError, match="form a circle"):
        kd.System.from_elements([SUN, from_spk(rocks)])


def test_a_kernel_joins_bodies_over_others(rocks):
    moon = kd.System.from_elements([SUN, from_spk(rocks, target=2000002, origin=2000001, plane="equator")])
    apart = moon["rock"].position - moon["Sun"].position
    np.testing.assert_allclose(apart, np.array([1e5 + 100.0, 2e5 + 200.0, 3e5 + 300.0]) * 1e3 / AU, rtol=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"date": "2001-01-01"},
            r"date: the kernel has 2000001 from 2000-01-01T12:00 to 2000-04-10T12:00, got 2001-01-01",
        ),
        ({"target": 7}, r"spk: no path from 7 to 10 in the kernel, which has 10 from 0, 2000001 from 0, 2000002 from"),
        ({"date": "soon"}, "date: expected a Julian date or a date such as 2000-01-01T12:00, got 'soon'"),
        ({"spk": "none.bsp"}, "spk: there is no file none.bsp"),
        ({"a": 1.0}, "a: excluded by spk"),
        ({"date": None}, "date: required with horizons and spk"),
        ({"target": None}, "target: the number of the body in the kernel is missing"),
        ({"horizons": "1;"}, "expected exactly one of horizons, spk, got horizons and spk"),
    ],
)
def test_what_is_refused(rocks, given, message):
    body = {key: value for key, value in from_spk(rocks, **given).items() if value is not None}
    with pytest.raises(InputError, match=message):
        kd.System.from_elements([SUN, body])


def test_a_file_that_is_no_kernel(tmp_path):
    pytest.importorskip("jplephem")
    (tmp_path / "text.bsp").write_text("no kernel\n" * 500)
    with pytest.raises(InputError, match=r"spk: text.bsp is no SPK kernel that jplephem can read: ValueError"):
        kd.System.from_elements([SUN, from_spk(tmp_path / "text.bsp")])


def test_keys_of_jpl_need_a_source():
    with pytest.raises(InputError, match="date: goes with horizons or spk"):
        kd.System.from_elements([SUN, {"mass": 0.0, "a": 1.0, "date": "2025-01-01"}])
    with pytest.raises(InputError, match='horizons: goes with frame = "heliocentric", not "jacobi"'):
        kd.System.from_elements([SUN, ceres()], frame="jacobi")
