"""References for what a run used, in BibTeX."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from typing import Any

from kickdrift.engines import ENGINES
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.integrators import INTEGRATORS
from kickdrift.systemfile.files import is_shipped
from kickdrift.systemfile.reading import load
from kickdrift.text import shown

_DOI = re.compile(r"doi:\s?(10\.\d+/[^\s;,]*[^\s;,.])")
_REFERENCE = re.compile(
    r"^(?:[\w ]+:\s)?(?P<who>[^\d:]+?),? (?P<year>1[5-9]\d\d|20\d\d)\b[a-z]?(?P<rest>.*)$", re.DOTALL
)
_JOURNAL = re.compile(r"^(?P<journal>[^\d]+?) (?P<volume>\d+), (?P<pages>[\w.]+)$")
_AUTHORS = r"((?:[A-Z][\w'’-]+(?:, | & | and )?)+(?: et al\.)?)"
_YEAR = r"((?:1[6-9]|20)\d\d)"
_OWN_DOI = r"doi:\s?10\.\d+/[^\s;,)]*[^\s;,.)]"
_PLACE = r"[A-Z][\w&.: ]*? \d+, \w+"  # journal, volume and first page
_CITED = re.compile(  # authors, year, and DOI, journal or book, in running text
    rf"{_AUTHORS},? \(?{_YEAR}[a-z]?\)?,? ?(?:[^.;()]*?({_OWN_DOI})|({_PLACE})|([A-Z]\w+(?: [A-Z]\w+)+))"
)
_CITED_BY_PLACE = re.compile(rf"{_AUTHORS}, ({_PLACE}) \({_YEAR}\), ({_OWN_DOI})")
RESCALING = "Woodcock 1971, Chem. Phys. Lett. 10, 257, doi:10.1016/0009-2614(71)80281-6"
FRAGMENTS = "Leinhardt & Stewart 2012, doi:10.1088/0004-637X/745/1/79"
KICKDRIFT = """@software{{kickdrift,
  author = {{{{The kickdrift developers}}}},
  title = {{kickdrift: molecular dynamics and N-body simulation in which the integrator is a measured choice}},
  version = {{{version}}},
}}"""


def cite(name_or_path: str | os.PathLike[str]) -> str:
    """References in BibTeX: for a run's file its method, forces, system and engine; else for one of these by its name.

    Each entry holds what kickdrift knows of its source: authors, year, DOI, and journal where it is known. The first
    entry is kickdrift itself.

    Raises
    ------
    InputError
        For a name that is no method, force, system or engine, and a file that is neither a run nor a system.
    """
    texts = list(dict.fromkeys(_sources(os.fspath(name_or_path))))
    works: dict[str, dict[str, str]] = {}  # fields by what names a work: its DOI, else its authors and year
    for text in texts:
        for reference in re.split(r";\s+", text):
            if fields := _fields(" ".join(reference.split())):
                known = works.setdefault(fields.get("doi", fields["author"] + fields["year"]), fields)
                known |= {key: value for key, value in fields.items() if key not in known}
    keys = _keys(works.values())
    entries = [_entry(key, fields) for key, fields in zip(keys, works.values(), strict=True)]
    return "\n\n".join([KICKDRIFT.format(version=version("kickdrift")), *entries])


def _sources(name: str) -> Iterator[str]:
    if name in INTEGRATORS:
        yield INTEGRATORS[name].source
    elif name in FORCES:
        yield from _of_force(FORCES[name])
    elif name in ENGINES:
        yield ENGINES[name].source
    elif name.endswith((".h5md", ".h5")):
        from kickdrift.trajectory.opened import open as opened

        with opened(name) as run:
            recorded: Any = run
            made = dict(recorded.method)
            yield _of_method(made.get("integrator"))
            yield ENGINES[made["engine"]].source if made.get("engine") in ENGINES else ""
            if hasattr(recorded, "system_record"):
                yield from _of_system(recorded.system(), made.get("integrator"))
    elif is_shipped(name) or name.endswith(".toml"):
        subject: Any = load(name)
        yield _of_method(subject.run.integrator)
        yield from _of_system(subject, subject.run.integrator)
    else:
        raise InputError(
            f"cite: {shown(name)} is no method, force, system or engine, and no run's file; "
            "see kickdrift list integrators"
        )


def _of_method(name: Any) -> str:
    """Source of a method; "" for an unknown one."""
    return INTEGRATORS[name].source if name in INTEGRATORS else ""


def _of_system(subject: Any, method: Any) -> Iterator[str]:
    """Sources of a System's equilibration, forces and collisions, and of its reference values."""
    if asked := getattr(subject, "equilibration", None):
        by = asked.integrator or method
        yield INTEGRATORS[by].source if by in INTEGRATORS and INTEGRATORS[by].bath else RESCALING
    if any(getattr(event, "action", None) == "fragment" for event in getattr(subject, "events", ())):
        yield FRAGMENTS
    for force in getattr(subject, "forces", ()):
        if hasattr(force, "sources"):
            yield force.sources(subject)
        else:
            yield from _of_force(type(force))
    if source := dict(getattr(subject, "invariants", {}) or {}).get("source"):
        yield str(source)


def _of_force(cls: Any) -> Iterator[str]:
    """Sources that the docstring of a class of forces cites with a DOI, a journal or a book."""
    texts: Iterable[str] = [cls.__doc__ or "", getattr(getattr(cls, "Parameters", None), "__doc__", "") or ""]
    for text in texts:
        text = " ".join(text.split())
        for who, place, year, doi in _CITED_BY_PLACE.findall(text):
            yield f"{who} {year}, {place}, {doi}"
        for who, year, *where in _CITED.findall(text):
            yield f"{who.strip(' ,')} {year}, {''.join(where)}"


def _fields(reference: str) -> dict[str, str] | None:
    """Fields of the entry of one reference; None for a text that names no work."""
    found = _REFERENCE.match(reference)
    if found is None:
        return None
    who, year = re.sub(r"^(?:dense output|step:) ", "", found["who"]).strip(" ,"), found["year"]
    doi = _DOI.search(found["rest"])
    rest = (found["rest"][: doi.start()] if doi else found["rest"]).strip(" ,")
    authors = re.sub(r"\s*(?:,|&)\s*", " and ", re.sub(r"['’]s\b", "", who).replace(" et al.", " and others"))
    fields = {"author": authors, "year": year}
    if journal := _JOURNAL.match(rest):
        fields |= journal.groupdict()
    elif rest:
        fields["note"] = rest
    return fields | ({"doi": doi[1]} if doi else {})


def _keys(works: Iterable[dict[str, str]]) -> list[str]:
    """Key of each work: first author and year, with a letter for a second work of both."""
    found: list[str] = []
    for fields in works:
        first = re.sub(r"\W", "", fields["author"].split(" and ")[0].split()[-1]).lower() + fields["year"]
        found.append(next(key for letter in ("", *"bcdefghijklmnop") if (key := first + letter) not in found))
    return found


def _entry(key: str, fields: dict[str, str]) -> str:
    escaped = {name: value if name == "doi" else re.sub(r"([&%#_])", r"\\\1", value) for name, value in fields.items()}
    lines = [f"  {name} = {{{value}}}," for name, value in escaped.items()]
    return "\n".join([f"@{'article' if 'journal' in fields else 'misc'}{{{key},", *lines, "}"])
