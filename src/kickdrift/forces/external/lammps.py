"""`LammpsForce`: pair styles of LAMMPS as a force. Importing this module imports neither LAMMPS nor numba."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from kickdrift.disk.files import refuse_unfit
from kickdrift.errors import InputError
from kickdrift.forces.external.lammps_library import potential_folders
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.seam.arguments import check_massive
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.forces.external.kernel import ExternalKernel
    from kickdrift.forces.external.lammps_host import LammpsHost
    from kickdrift.model.subject import Subject

UNITS = {"lj": "lj", "nbody": "lj", "metal": "metal", "real": "real"}  # LAMMPS' names of unit systems
RENEWAL = {"lj": 0.15, "nbody": 0.15, "metal": 0.5, "real": 0.5}  # lengths; the skin of LAMMPS' lists is twice as long
ALONG_BONDS = tuple(
    f"{kind}_{word}" for kind in ("bond", "angle", "dihedral", "improper") for word in ("style", "coeff")
)
COMMANDS = ("pair_modify", "kspace_style", "kspace_modify", "special_bonds", "dielectric", *ALONG_BONDS)
MOST_WAVES = 1e8
FINEST = 1e-12  # accuracy of kspace_style, below which LAMMPS' sums have no end
PLAIN = frozenset(
    "!*+,-./0123456789:=@ABCDEFGHIJKLMNOPQRSTUVWXYZ[]_abcdefghijklmnopqrstuvwxyz~ "
)  # no quote, no variable
REFUSED = {
    "python": "runs Python code", "mliap": "may run Python code", "kim": "loads libraries", "bop": "may write files",
    "mesocnt": "may write files", "quartic": "breaks bonds for ever", "scafacos": "loads libraries",
}  # fmt: skip
ATOM_STYLES = ("atomic", "charge")


def digest_of(word: str) -> str:
    """SHA-256 of the file that LAMMPS finds under a word of a command; "" if the word names none."""
    places = (Path(), *potential_folders())
    path = next((place / word for place in places if os.path.isfile(place / word)), None)
    if path is None:
        return ""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def script_lines(text: str) -> list[str]:
    """Commands of an input script, without comments; a line that ends in & goes on in the next."""
    lines = re.sub(r"&[ \t]*\r?\n", " ", text).splitlines()
    return [line for each in lines if (line := " ".join(each.partition("#")[0].split()))]


def number_of(word: str) -> float:
    """The number of a word, or nan."""
    try:
        return float(word)
    except ValueError:
        return math.nan


@checked_arguments
@dataclass(frozen=True)
class LammpsForce(Field):
    """Styles of LAMMPS as a force, such as MEAM, SNAP or ReaxFF.

    ``kd.LammpsForce("meam", "* * library.meam Cu Cu.meam Cu")`` gives LAMMPS the commands ``pair_style`` and
    ``pair_coeff``. Its types are the system's species in their order, from 1. LAMMPS also has the charges and the
    topology: its bonds, angles, dihedrals and impropers with their types, and ``special_bonds`` from its factors.
    Types of bonds are numbers, or named as in the topology. kickdrift takes the steps, so every
    method, bath, barostat, file and restart serves this force as it serves others. LAMMPS computes forces, energy and
    virial in this process, in the units of the system: ``metal``, ``real``, ``lj`` or ``nbody``. Thompson et al. 2022,
    doi:10.1016/j.cpc.2021.108171.

    LAMMPS finds files of potentials in the folder of the run, or in its own folder of potentials. A run's file keeps
    the commands and the SHA-256 of each file that they name, and `resume` refuses a file that has changed.

    LAMMPS' lists of neighbours begin anew when an atom has moved by ``renewal``, and a run's checkpoints keep the
    positions of that beginning. So a resumed run has the same bits.

    Parameters
    ----------
    pair_style : LAMMPS' pair style with its arguments; "" if ``commands`` has it
    pair_coeff : its coefficients, one text or several
    commands : further commands, or lines of an input script: pair_modify, kspace_style, kspace_modify, special_bonds,
        dielectric, and style and coeff of bonds, angles, dihedrals and impropers
    atom_style : "atomic" keeps charges from LAMMPS, "charge" gives them, zeros if the system has none; default: charges
        if the system has them
    renewal : length; default 0.5 angstrom, or 0.15 in units lj
    files : SHA-256 of each file that the commands name, by its name; default those of the files as they are

    Raises
    ------
    InputError
        For other commands, and for styles that run Python code, load libraries or write files. When a System is made,
        without LAMMPS, for two dimensions, other units, and whatever LAMMPS says of the commands.
    """

    pair_style: str = ""
    pair_coeff: str | Sequence[str] = ()
    commands: str | Sequence[str] = ()
    atom_style: str | None = None
    renewal: float | None = None
    files: Mapping[str, str] | None = None

    name: ClassVar[str] = "lammps"
    may_overlap: ClassVar[bool] = False
    external: ClassVar[bool] = False
    thermal: ClassVar[bool] = True  # particles act on each other, so that samples have a temperature
    dimensions: ClassVar[dict[str, str]] = {"renewal": "length"}

    def __post_init__(self) -> None:
        rows = (self.pair_coeff,) if isinstance(self.pair_coeff, str) else self.pair_coeff
        lines = script_lines(self.commands) if isinstance(self.commands, str) else self.commands
        for key, given in (("pair_style", (self.pair_style,)), ("pair_coeff", rows), ("commands", lines)):
            if not isinstance(given, list | tuple) or not all(isinstance(each, str) for each in given):
                raise InputError(f"{self.name}: {key}: expected texts, got {shown(getattr(self, key))}")
        found: dict[str, list[str]] = {"pair_style": [self.pair_style] * bool(self.pair_style), "pair_coeff": [*rows]}
        further: list[str] = []
        for line in lines:
            first, _, rest = line.strip().partition(" ")
            found.get(first, further).append(rest.strip() if first in found else line)
        for key, given in (*found.items(), ("commands", further)):
            for line in given:
                self._check(key, line)
        if len(found["pair_style"]) != 1:
            what = "give one, such as 'zero 10.0' for forces along bonds alone"
            raise InputError(f"{self.name}: pair_style: {len(found['pair_style'])} are given; {what}")
        if self.atom_style not in (None, *ATOM_STYLES):
            raise InputError(
                f"{self.name}: atom_style: expected {' or '.join(ATOM_STYLES)}, got {shown(self.atom_style)}"
            )
        if self.renewal is not None and not self.renewal > 0:
            raise InputError(f"{self.name}: renewal must be a positive length, got {shown(self.renewal)}")
        object.__setattr__(self, "pair_style", found["pair_style"][0])
        object.__setattr__(self, "pair_coeff", tuple(found["pair_coeff"] or ("* *",)))
        object.__setattr__(self, "commands", tuple(further))
        words = " ".join([self.pair_style, *self.pair_coeff, *further]).split()
        files = {word: digest for word in words if (digest := digest_of(word))}
        for word, digest in (self.files or {}).items():
            if files.get(word) != digest:
                why = "has changed: its SHA-256 is not" if word in files else "is missing; its SHA-256 was"
                raise InputError(f"{self.name}: files: {shown(word)} {why} {shown(digest)}")
        object.__setattr__(self, "files", files)

    def _check(self, key: str, line: str) -> None:
        """Refuse what is no command of a force: other commands, several lines, variables."""
        words = line.split()
        if not words or not PLAIN.issuperset(line):
            raise InputError(f"{self.name}: {key}: expected one line of plain words, got {shown(line)}")
        for word in words:
            if word.lower().lstrip("+-") in ("nan", "inf", "infinity") or math.isinf(number_of(word)):
                raise InputError(
                    f"{self.name}: {key}: expected finite numbers, got {shown(word)}"
                )  # LAMMPS would crash
            if os.path.exists(word):
                refuse_unfit(word, "a file of a potential")  # a pipe would wait for ever, and a device may have no end
        if key == "commands":
            key, *words = words
            if key not in COMMANDS:
                raise InputError(f"{self.name}: commands: expected one of {', '.join(COMMANDS)}, got {shown(key)}")
        if key.endswith("_style") and (styles := [each for each in words if each.split("/")[0] in REFUSED]):
            why = REFUSED[styles[0].split("/")[0]]
            raise InputError(f"{self.name}: {key}: {styles[0]} {why}, which a force may not do here")
        if key == "kspace_style" and len(words) > 1 and not FINEST <= number_of(words[1]) < 1.0:
            raise InputError(f"{self.name}: kspace_style: the accuracy lies from {FINEST:g} to 1, got {words[1]}")

    @property
    def takes_charges(self) -> bool:
        """Whether charges of the System have an effect on the force."""
        return self.atom_style != "atomic"

    @property
    def label(self) -> str:
        """The pair style's name."""
        return self.pair_style.split()[0]

    def no_pressure(self, system: Subject) -> str:
        """Why samples have no pressure: they have one."""
        return ""

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: LAMMPS follows the box."""
        return ""

    def check(self, system: Subject) -> None:
        """Refuse systems that LAMMPS cannot take, and commands that it does not take."""
        if system.dimensions == 2:
            raise InputError(f"{self.name}: works in three dimensions, and the system has two")
        if system.units.name not in UNITS:
            raise InputError(f"{self.name}: works in the units {', '.join(UNITS)}, not {system.units.name!r}")
        if system.topology is not None and len(system.topology.exclusions):
            raise InputError(
                f"{self.name}: LAMMPS leaves out pairs by their bonds alone, and the topology has exclusions"
            )
        check_massive(self.name, system, range(len(system)))
        self._check_waves(system)
        self._host(system).open()

    def _check_waves(self, system: Subject) -> None:
        """Refuse a cutoff of charges so short that LAMMPS would sum over waves without end. In Ewald's sum both parts
        fall to the accuracy: erfc(alpha cutoff) in space, and exp(-k^2 / 4 alpha^2) over waves."""
        accuracy = next((number_of(line.split()[2]) for line in self.commands
                         if line.startswith("kspace_style ") and len(line.split()) > 2), 0.0)  # fmt: skip
        found = re.search(r"\S*/long\S*((?: [\d.eE+-]+)+)", f" {self.pair_style}")
        if not accuracy or found is None:
            return
        cutoff = number_of(found[1].split()[-1])
        digits = -math.log(accuracy)
        waves = system.volume * (2.0 * digits / cutoff) ** 3 / (6.0 * math.pi**2) if cutoff > 0 else math.inf
        if waves > MOST_WAVES and math.isfinite(system.volume):
            raise InputError(
                f"{self.name}: pair_style {self.pair_style}: with the cutoff {cutoff:g} and accuracy {accuracy:g}, "
                f"LAMMPS would sum over {waves:.0e} waves; take a longer cutoff"
            )

    def bind(self, system: Subject, threads: int = 1) -> ExternalKernel:
        """See Field."""
        return self._host(system).parts

    def _host(self, system: Subject) -> LammpsHost:
        from kickdrift.forces.external.lammps_host import lammps_host

        units = system.units.name
        return lammps_host(self, system, UNITS[units], self.renewal or RENEWAL[units])
