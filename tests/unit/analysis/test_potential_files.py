"""What files of potentials hold: crystals beside published ones, the commands, and files that are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from tests.folders import TOP
from tests.refusals import assert_refused

COPPER = TOP / "systems" / "Cu_zhou2004.eam.alloy"
CARBON = "C C C 1 1 0 38049 4.3484 -0.57058 0.72751 1.5724e-7 2.2119 346.74 1.95 0.15 3.4879 1393.6"


def test_copper_has_its_published_crystal():
    """Zhou, Johnson & Wadley 2004, doi:10.1103/PhysRevB.69.144113: 3.615 angstrom and 3.54 eV."""
    found = kd.analysis.potential_file(COPPER)
    first, *others = found.crystals
    assert (first.element, first.kind) == ("Cu", "fcc")
    assert first.constant == pytest.approx(3.615, abs=5e-4)
    assert first.energy == pytest.approx(-3.54, abs=5e-4)
    assert [each.kind for each in others] == ["bcc", "sc", "diamond"]
    assert all(each.energies.min() >= each.energy for each in found.crystals)


def test_carbon_of_a_file_with_two_names(tmp_path):
    """Tersoff 1989, doi:10.1103/PhysRevB.39.5566: diamond at 3.56 angstrom with 7.37 eV. X has no entries alone."""
    (tmp_path / "C.tersoff").write_text(f"# of a paper\n{CARBON}\n{CARBON.replace('C C C', 'X C C')}\n")
    found = kd.analysis.potential_file(tmp_path / "C.tersoff")
    assert found.note == "of a paper"
    assert {each.element for each in found.crystals} == {"C"}
    assert found.crystals[0].kind == "diamond"
    assert found.crystals[0].constant == pytest.approx(3.566, abs=0.01)
    assert found.crystals[0].energy == pytest.approx(-7.37, abs=0.01)
    assert ("X", "no fcc, bcc, sc or diamond crystal alone") in found.lines()


@pytest.mark.long
def test_commands(kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = kickdrift("info", COPPER)
    assert code == 0
    assert "fcc, a = 3.61498 angstrom, -3.53998 eV an atom" in out
    code, out, _ = kickdrift("plot", COPPER, "--output", "copper.png")
    assert (code, out.strip()) == (0, "copper.png")
    assert Path("copper.png").stat().st_size > 10_000
    Path("Cu.eam.alloy").write_text("a\nb\nc\n1 Cu\n5 0.1 5 0.1\n")
    for command in ("info", "plot"):
        assert_refused(
            kickdrift(command, "Cu.eam.alloy"), "eam: file: Cu.eam.alloy: no potential of the form eam/alloy"
        )
    assert_refused(kickdrift("plot", COPPER, "--kind", "rdf"), "--kind is for a run's file")
    assert_refused(kickdrift("info", COPPER, "--all"), "--all is for the file of a run")


def test_another_file_is_refused():
    with pytest.raises(InputError, match=r"^Cu.meam: expected the name of a potential's file, which ends in .eam, "):
        kd.analysis.potential_file("Cu.meam")
