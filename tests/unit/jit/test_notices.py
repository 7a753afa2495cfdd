"""Notices of compilation name the method and the force, and say whether the disk keeps the code."""

import numpy as np

from kickdrift.cli.main import compilation_said
from kickdrift.jit.cache.notices import announce, compiling_for, compiling_part, heard, machine_code
from kickdrift.jit.compile import driver
from kickdrift.looks.record import WRITING, Record


def twice(x):
    return x[0] + x[0]


def test_whoever_listens_hears_of_code_that_is_compiled_and_of_no_other(monkeypatch):
    monkeypatch.setattr("kickdrift.jit.cache.cache.folder", lambda: None)  # nothing is on disk, and nothing is kept
    monkeypatch.setattr("kickdrift.jit.cache.cache.warm", lambda: ())
    compiled, said, record = driver(twice), [], Record()
    with heard(lambda *what: said.append(what)), compiling_for("a test"):
        with record.spending(WRITING):
            assert compiled(np.array([2.0])) == 4.0
        assert said == [("a test", False)]
        compiled(np.array([3.0]))
    assert said == [("a test", False)]
    driver(twice)(np.array([1.0]))
    assert len(said) == 1
    assert record.compile_seconds > 10 * record.spent[WRITING]  # which waited for the compilation, and counts it apart
    with machine_code.made(), machine_code.made():
        before = machine_code.seconds
    assert machine_code.seconds > before


def test_the_command_line_says_each_purpose_once(capsys):
    for quiet in (False, True):
        with compilation_said(quiet):
            with compiling_for("velocity-verlet for lennard-jones"):
                announce(kept=True)
                for k in (1, 2):
                    with compiling_part(k, 2, "force"):
                        announce(kept=True)
                with compiling_part(1, 1, "force"):
                    announce(kept=True)
            announce(kept=False)
    out, err = capsys.readouterr()
    assert out == ""
    line = "compiling velocity-verlet for lennard-jones{} (once on this machine)\n"
    assert err == "".join(line.format(part) for part in ("", ", force 1 of 2", ", force 2 of 2")) + "compiling\n"
