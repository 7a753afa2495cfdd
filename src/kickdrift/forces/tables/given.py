"""What users say of a table, common to pairs, bonds, angles and dihedrals."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.seam.arguments import number
from kickdrift.forces.tables.reading import Columns, columns_of, read
from kickdrift.model.checks.values import is_number
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

UNITS_OF_XVG = "gromacs"


@dataclass(frozen=True)
class Tables:
    """Parameters of every force whose laws are tables.

    Attributes
    ----------
    file : str, optional
        File of the table, kept as an absolute path; in a system file relative to that file. It is LAMMPS' table (of
        ``pair_style table`` and so on), GROMACS' ``.xvg``, or has two or three columns: place, energy and force.
    keyword : str, optional
        Section of LAMMPS' file; needed if the file has several.
    table : ((x, energy), …) or ((x, energy, force), …), optional
        The numbers themselves, in place of a file. Angles are in degrees, and forces of angles for each degree.
    length_unit : float, optional
        Length of one unit of the table, such as "1 nm"; default the System's unit.
    energy_unit : float, optional
        Likewise of energy.
    c6, c12 : float
        Factors of the dispersion and the repulsion in GROMACS' tables of seven columns; default 1.
    digest : str
        SHA-256 of the files, kept with a run: files that have changed are refused. Default: of the files as they are.
    """

    file: str | None = None
    keyword: str | None = None
    table: Sequence[Sequence[float]] | None = None
    length_unit: float | None = None
    energy_unit: float | None = None
    c6: float = 1.0
    c12: float = 1.0
    digest: str = ""

    name: ClassVar[str]
    law_keys: ClassVar[tuple[str, ...]] = ("energy_unit", "file", "keyword", "table", "c6", "c12", "length_unit")
    units_of: ClassVar[tuple[str, ...]] = ("length_unit", "energy_unit")  # what says the units of a table
    dimensions: ClassVar[dict[str, str]] = {"length_unit": "length", "energy_unit": "energy"}

    def keep_files(self, *keys: str) -> None:
        """Read the files, check the digest, and keep paths that hold elsewhere and numbers that do not change. ``keys``
        name the force's tables of tables."""
        contents: dict[str, bytes] = {}
        own = self._kept({key: getattr(self, key) for key in self.law_keys}, contents)
        for key, value in own.items():
            object.__setattr__(self, key, value)
        for key in keys:
            inner = getattr(self, key)
            if isinstance(inner, Mapping):
                kept = {k: self._kept(v, contents) if isinstance(v, Mapping) else v for k, v in inner.items()}
                object.__setattr__(self, key, kept)
        digest = hashlib.sha256(b"".join(hashlib.sha256(each).digest() for each in contents.values())).hexdigest()
        if not isinstance(self.digest, str):
            raise InputError(f"{self.name}: digest: expected text, got {shown(self.digest)}")
        if self.digest and self.digest != digest:
            named = " or ".join(contents) or "the table"
            raise InputError(f"{self.name}: file: {named} has changed: its SHA-256 is not {shown(self.digest)}")
        object.__setattr__(self, "digest", digest if contents else "")
        object.__setattr__(self, "_contents", contents)
        object.__setattr__(self, "_made", {})

    def _kept(self, given: Mapping[str, Any], contents: dict[str, bytes]) -> dict[str, Any]:
        found = dict(given)
        if found.get("file") is not None and found.get("table") is not None:
            raise InputError(f"{self.name}: give table or file, not both")
        if not isinstance(found.get("keyword"), str | None):
            raise InputError(f"{self.name}: keyword: expected text, got {shown(found['keyword'])}")
        if found.get("table") is not None:
            for key, none in (("keyword", None), ("c6", 1.0), ("c12", 1.0)):
                if found.get(key, none) != none:
                    raise InputError(f"{self.name}: {key} goes with file")
        if found.get("file") is not None:
            content = read(self.name, found["file"])
            found["file"] = os.path.abspath(found["file"])
            contents[found["file"]] = content
        for key in ("length_unit", "energy_unit", "c6", "c12"):
            if found.get(key) is not None:
                found[key] = number(self.name, key, found[key])
                if key.endswith("unit") and not found[key] > 0:
                    raise InputError(f"{self.name}: {key} must be positive, got {shown(given[key])}")
        rows = found.get("table")
        if rows is not None and not isinstance(rows, str | Mapping) and hasattr(rows, "__iter__"):
            found["table"] = tuple(tuple(row) if hasattr(row, "__iter__") else row for row in rows)
            if not all(is_number(each) for row in found["table"] if isinstance(row, tuple) for each in row):
                raise InputError(f"{self.name}: table: expected rows of two or three numbers")
        return found

    def __getstate__(self) -> dict[str, Any]:
        """The force without the addresses of its tables, which hold in this process alone."""
        return {**vars(self), "_made": {}}

    def given_with(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """What is said of a table with these values in place of the force's own."""
        own = {key: getattr(self, key) for key in self.law_keys}
        if any(values.get(key) is not None for key in ("file", "table")):
            own |= {"file": None, "table": None, "keyword": None}
        return own | dict(values)

    def law_with(self, where: str, values: Mapping[str, Any]) -> Any:
        """Parameters of the law of the force's table, or of the one in these values; ``where`` says whose they are."""
        given = self.given_with(values)
        key = tuple(given[each] for each in self.law_keys)
        if key not in self._made:  # type: ignore[attr-defined]
            columns = columns_of(f"{self.name}{where}", given, self._contents)  # type: ignore[attr-defined]
            place = "" if given["file"] is None else f": file: {given['file']}"
            made = self.law_of_columns(f"{self.name}{where}{place}", columns, given)
            self._made[key] = made  # type: ignore[attr-defined]
        return self._made[key]  # type: ignore[attr-defined]

    def law_of_columns(self, where: str, columns: Columns, given: Mapping[str, Any]) -> Any:
        """Parameters of the law of a table's numbers; ``where`` begins messages."""
        raise NotImplementedError

    @property
    def law(self) -> Any:
        """Parameters of the law of the force's own table; nan if only its ``species``, ``pairs`` or ``types`` have
        tables."""
        if self.file is None and self.table is None:
            return self.Parameters(*[float("nan")] * len(self.Parameters._fields))  # type: ignore[attr-defined]
        return self.law_with("", {})

    def __repr__(self) -> str:
        parts = []
        for each in fields(self):
            value = getattr(self, each.name)
            if each.repr and value != each.default and each.name != "digest":
                parts.append(f"{each.name}={_brief(each.name, value)}")
        return f"{type(self).__name__}({', '.join(parts)})"

    def check_units(self, system: Subject, given: Mapping[str, Any]) -> None:
        """Refuse a file whose numbers are in other units than the System's, unless the user says what they are."""
        if given.get("file") is None or all(given.get(key) is not None for key in self.units_of):
            return
        said = columns_of(self.name, given, self._contents).units  # type: ignore[attr-defined]
        units = UNITS_OF_XVG if said == "xvg" else said
        if not units or units == system.units.name or (said == "xvg" and system.units.reduced):
            return
        of = "is GROMACS', in nm and kJ/mol" if said == "xvg" else f"says UNITS: {units}"
        raise InputError(
            f"{self.name}: file: {given['file']} {of}, and the System has units {system.units.name!r}; "
            f"{' and '.join(self.units_of)} say{'s' * (len(self.units_of) == 1)} how large one unit of the table is"
        )


def _brief(key: Any, value: Any) -> str:
    """A parameter as text, in which tables have their number of rows."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{each!r}: {_brief(each, one)}' for each, one in value.items())}}}"
    return f"({len(value)} rows)" if key == "table" and isinstance(value, tuple) else repr(value)
