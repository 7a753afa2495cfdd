"""Every wrong input of the table gets its one line, which names what is wrong and says what to write."""

from __future__ import annotations

import math
import shlex
from typing import NamedTuple

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.systemfile.reading import loads
from tests.wrong_inputs import COMMANDS, FILE, FILES, PYTHON

X = [[0, 0, 0], [1.5, 0, 0]]


class EnergyAlone(NamedTuple):
    """A law without a force."""

    k: float = 1.0

    def law(p, r2):
        return p.k / r2


class WrongSlope(NamedTuple):
    """A law whose force lacks a factor of two."""

    k: float = 1.0

    def law(p, r2):
        return p.k / r2, p.k / (r2 * r2)


@pytest.fixture(scope="module")
def names():
    bodies = kd.System(
        [[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 1, 0]], masses=[1, 1e-3], names=["Sun", "a"], forces=[kd.Gravity()],
        units="nbody",
    )  # fmt: skip
    still = kd.System(X, forces=[kd.LennardJones()])
    pair = kd.System([[0, 0, 0], [1, 1, 1]], constraints=[kd.Constraint(pairs=[(0, 1)])])
    laws = {"EnergyAlone": EnergyAlone, "WrongSlope": WrongSlope}
    yield {"kd": kd, "math": math, "X": X, "L": kd.load("lj-1000"), "B": bodies, "PAIR": pair, "STILL": still, **laws}
    for name in ("energy-alone", "wrong-slope"):
        FORCES.pop(name, None)


def assert_line(found: str, expected: str) -> None:
    assert "\n" not in found
    assert found.startswith(expected[:-1]) if expected.endswith("…") else found == expected


@pytest.mark.parametrize(("typed", "line"), PYTHON, ids=[typed for typed, _ in PYTHON])
def test_python(names, typed, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as error:
        eval(typed, dict(names))
    assert_line(str(error.value), line)
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(("typed", "line"), COMMANDS, ids=[typed for typed, _ in COMMANDS])
def test_commands(kickdrift, typed, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(FILE)
    status, out, err = kickdrift(*shlex.split(typed))
    assert (status, out) == (2, "")
    assert_line(err.rstrip("\n"), line)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]
    assert (tmp_path / "mine.toml").read_text() == FILE


@pytest.mark.parametrize(("old", "new", "line"), FILES, ids=[new for _, new, _ in FILES])
def test_files(old, new, line):
    assert old in FILE
    with pytest.raises(InputError) as error:
        loads(FILE.replace(old, new, 1))
    assert_line(str(error.value), line)
