"""The program that lets LAMMPS read an input in a process of its own, and tells what LAMMPS then holds.

Arguments: the commands, the file of the answer, and the limit of processor time. The working folder is the input's.
"""

import contextlib
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.disk.posix import limit_processor_time
from kickdrift.forces.external.lammps_library import lammps_class

GLOBALS = ("units", "dt", "boxlo", "boxhi", "xy", "xz", "yz", "periodicity", "special_lj", "special_coul")
COLUMNS = ("x", "v", "image", "type", "q", "rmass")
LISTS = ("bonds", "angles", "dihedrals", "impropers")
MATRICES = ("epsilon", "sigma", "lj14_3", "lj14_4")  # the last two: 4 epsilon sigma^12 and ^6, of CHARMM's 1-4 pairs
_DAMAGED = re.compile(r"Last input line:.*|\(src/\S+\)|For more information see \S+")


def main() -> None:
    """Read the input and write the answer."""
    commands, answer, seconds = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    limit_processor_time(seconds)
    lmp = lammps_class()(cmdargs=["-log", "none", "-nocite", "-echo", "none"])
    told: dict[str, Any] = {}
    arrays: dict[str, Any] = {}
    try:
        lmp.file(str(commands))
        styles = [
            line.split()[1:2] for line in commands.read_text("utf-8").splitlines() if line.startswith("pair_style")
        ]
        told, arrays = _state(lmp, answer.with_name("coefficients.data"), not styles or styles[-1] == ["none"])
    except Exception as error:
        text = str(error)
        last = re.search(r"Last input line: (.*)", text)
        said = " ".join(_DAMAGED.sub("", text).split()).removeprefix("ERROR: ").removesuffix(".")
        told = {"error": said + (f" ({' '.join(last[1].split())})" if last else "")}
    np.savez(answer, told=np.array(json.dumps(told)), **arrays)
    lmp.close()


def _state(lmp: Any, data: Path, pairless: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """What LAMMPS holds after its set-up: numbers by name, and arrays in the order of the particles' ids. A system
    without a pair style is ``pairless``, and LAMMPS then tells no coefficients of pairs."""
    if not lmp.get_natoms():
        return {"error": "the input makes no atoms before its first run"}, {}
    for line in ("thermo_style one", "thermo_modify norm no flush yes", "run 0 post no"):
        lmp.command(line)
    n = int(lmp.get_natoms())
    ids = lmp.numpy.extract_atom("id")[:n]
    order = np.argsort(ids)
    told = {key: lmp.extract_global(key) for key in GLOBALS}
    told |= {"atom_style": lmp.extract_global("atom_style"), "dimensions": lmp.extract_setting("dimension")}
    arrays = {"id": ids[order].copy()}
    for key in COLUMNS:
        found = lmp.numpy.extract_atom(key)
        if found is not None:
            arrays[key] = np.array(found[:n])[order]
    mass = lmp.numpy.extract_atom("mass")
    if mass is not None:
        arrays["mass"] = np.array(mass).ravel()
    for kind in LISTS:
        if lmp.extract_setting(f"n{kind}"):
            arrays[kind] = np.array(getattr(lmp.numpy, f"gather_{kind}")())
    for key in () if pairless else MATRICES:
        with contextlib.suppress(Exception):  # styles differ in what they tell
            if (found := lmp.extract_pair(key)) is not None:
                upper = np.triu(np.array(found, dtype=float))  # the rest is not set
                arrays[f"pair_{key}"] = upper + np.triu(upper, 1).T
    lmp.command(f"write_data '{data}'" + ("" if pairless else " pair ij"))
    told["coefficients"] = _head(data)
    return told, arrays


def _head(data: Path) -> str:
    """The text of a data file up to its atoms."""
    lines = []
    with data.open(encoding="utf-8") as file:
        for line in file:
            if line.startswith("Atoms"):
                break
            lines.append(line)
    return "".join(lines)


if __name__ == "__main__":
    main()
