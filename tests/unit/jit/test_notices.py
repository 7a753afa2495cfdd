"""Notices of compilation name the method and the force, and say whether the disk keeps the code."""

import numpy as np

from kickdrift.cli.main import compilation_said
from kickdrift.jit.cache.notices import announce, compiling_for, heard
from kickdrift.jit.compile import driver


def twice(x):
    return x[0] + x[0]


def test_whoever_listens_hears_of_code_that_is_compiled_and_of_no_other(monkeypatch):
    monkeypatch.setattr("kickdrift.jit.cache.cache.folder", lambda: None)  # nothing is on disk, and nothing is kept
    monkeypatch.setattr("kickdrift.jit.cache.cache.warm", lambda: ())
    compiled, said = driver(twice), []
    with heard(lambda *what: said.append(what)), compiling_for("a test"):
        assert compiled(np.array([2.0])) == 4.0
        assert said == [("a test", False)]
        compiled(np.array([3.0]))
    assert said == [("a test", False)]
    driver(twice)(np.array([1.0]))
    assert len(said) == 1


def test_the_command_line_says_each_purpose_once(capsys):
    for quiet in (False, True):
        with compilation_said(quiet):
            with compiling_for("velocity-verlet for lennard-jones"):
                announce(kept=True)
                announce(kept=True)
            announce(kept=False)
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "compiling velocity-verlet for lennard-jones (once on this machine)\ncompiling\n"
