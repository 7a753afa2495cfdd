"""A user's force: named in a system file, listed, run, and refused if its name belongs to another force or its code
fails."""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.seam import named

FORCE = """
import math
from typing import NamedTuple

import kickdrift as kd


@kd.pair_law
class Gaussian(NamedTuple):
    \"\"\"U(r) = height exp(-(r / width)^2 / 2); Stillinger 1976, doi:10.1063/1.432891.\"\"\"

    height: float = 1.0
    width: float = 1.0

    dimensions = {"height": "energy", "width": "length"}

    def law(p, r2):
        energy = p.height * math.exp(-0.5 * r2 / p.width**2)
        return energy, energy / p.width**2
"""
SYSTEM = """
units = "lj"

[particles]
positions = [[0, 0, 0], [1.5, 0, 0]]

[[force]]
type = "gaussian"
height = 2.0
cutoff = 3.0
truncation = "cut"

[run]
dt = 0.01
steps = 20
"""


@pytest.fixture(autouse=True)
def own(monkeypatch):
    """Remove a test's registrations after the test."""
    monkeypatch.setattr(named, "REGISTERED", dict(named.REGISTERED))
    before = dict(FORCES)
    yield
    FORCES.clear()
    FORCES.update(before)


@pytest.fixture
def files(tmp_path):
    (tmp_path / "gaussian_force.py").write_text(FORCE)
    (tmp_path / "pair.toml").write_text(SYSTEM)
    return tmp_path


def test_a_system_file_names_a_force_of_ones_own(kickdrift, files):
    load, system, run = (str(files / name) for name in ("gaussian_force.py", "pair.toml", "run.h5md"))
    status, out, err = kickdrift("--load", load, "run", system, "--output", run)
    assert (status, err) == (0, "")
    with kd.open(run) as found:
        first = found.observables["potential_energy"][0]
    assert first == pytest.approx(2.0 * 0.32465246735834974, rel=1e-14)  # exp(-1.125)
    status, out, _ = kickdrift("--load", load, "list", "forces")
    assert status == 0
    assert "gaussian" in out
    assert "height" in out
    assert kickdrift("--load", load, "resume", run, "--steps", "25")[0] == 0


def test_without_its_file_the_line_says_what_to_load(kickdrift, files):
    status, _, err = kickdrift("run", str(files / "pair.toml"))
    assert status == 2
    assert "force[0].type: expected one of " in err
    assert "got 'gaussian'; a force of your own comes with --load FILE.py" in err
    assert len(err.splitlines()) == 1


def test_a_wrong_parameter_is_named(kickdrift, files):
    path = files / "pair.toml"
    path.write_text(SYSTEM.replace("height = 2.0", "heigth = 2.0"))
    status, _, err = kickdrift("--load", str(files / "gaussian_force.py"), "run", str(path))
    assert status == 2
    assert "force[0].heigth" in err
    assert len(err.splitlines()) == 1


def test_a_name_that_is_taken():
    def trap(**body):
        return type("Trap", (kd.HarmonicTrap,), {"__module__": "a", "__qualname__": "Trap", **body})

    assert kd.register_force(trap()) is named.REGISTERED["a", "Trap"]
    assert FORCES["harmonic-trap"] is kd.HarmonicTrap  # a class with an inherited name does not replace the force
    with pytest.raises(
        InputError, match=r"^force 'gravity' exists already: Gravity of kickdrift\.forces\.gravity\.direct$"
    ):
        kd.register_force(trap(name="gravity"))
    with pytest.raises(InputError, match=r"^force 'gravity' exists already"):
        kd.register_force(trap(name="gravity"), overwrite=True)
    first = kd.register_force(trap(name="steep trap"))
    assert FORCES["steep trap"] is first
    again = kd.register_force(trap(name="steep trap"))  # as when a module is loaded again
    assert FORCES["steep trap"] is again
    with pytest.raises(InputError, match=r"^force 'steep trap' exists already: Trap of a; overwrite=True replaces it"):
        kd.register_force(trap(name="steep trap", __module__="b"))
    other = kd.register_force(overwrite=True)(trap(name="steep trap", __module__="b"))
    assert FORCES["steep trap"] is other
    for name in ("", " x", 3, None):
        with pytest.raises(InputError, match=r"^register_force: a force's name must be a word, got "):
            kd.register_force(trap(name=name))


def test_a_kernel_that_does_not_compile(kickdrift, files):
    (files / "broken.py").write_text(
        FORCE.replace("return energy, energy / p.width**2", "return energy, energy / p.widht**2")
    )
    status, _, err = kickdrift("--load", str(files / "broken.py"), "run", str(files / "pair.toml"))
    assert status == 2
    assert len(err.splitlines()) == 1
    assert "widht" in err


def test_laws_of_one_name():
    """A system file's name means the last of a user's laws of that name, but kickdrift's own laws keep their names."""

    def law(cls, module):
        made = namedtuple(cls, ["k"], defaults=[1.0])
        made.__module__, made.law = module, lambda p, r2: (p.k * r2, -2.0 * p.k)
        return kd.pair_law(made)

    first, second = law("Square", "one"), law("Square", "two")
    assert FORCES["square"] is second
    assert named.registered("one", "Square") is first
    with pytest.raises(InputError, match=r"^force 'lennard-jones' exists already: LennardJones of kickdrift\."):
        law("LennardJones", "mine")
    assert FORCES["lennard-jones"] is kd.LennardJones


def test_a_law_whose_force_is_not_the_slope_of_its_energy_is_refused():
    class Wrong(NamedTuple):
        strength: float = 1.0

        def law(p, r2):
            return p.strength / r2, p.strength / (r2 * r2)  # the force lacks a factor 2

    made = kd.pair_law(Wrong)
    with pytest.raises(InputError, match=r"wrong: law\(p, r2\) must return energy and force over r.*at r = 2.85 "):
        made(cutoff=3.0)
    with pytest.raises(InputError, match="wrong of species A: law"):
        made(cutoff=3.0, species={"A": {"strength": 2.0}})


def test_a_law_may_jump():
    class Step(NamedTuple):
        height: float = 1.0

        def law(p, r2):
            inside = r2 < 3.8025  # the jump is at one of the distances where laws are checked
            return (p.height if inside else 0.0), 0.0

    assert kd.pair_law(Step)(cutoff=3.0).height == 1.0
