"""Tables that scripts write into pages of the documentation, between two comments that stand there.

python -m kickdrift_validation.docs_tables     (writes the options of integrators into docs/integrators.md, and the
                                                pair laws into docs/system-file.md)
"""

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

from kickdrift_validation.folders import checkout

BEGIN, END = "<!-- options: kickdrift_validation.docs_tables writes them -->", "<!-- end of options -->"
LAWS, LAWS_END = "<!-- pair laws: kickdrift_validation.docs_tables writes them -->", "<!-- end of pair laws -->"


def put(page: Path, begin: str, end: str, text: str) -> None:
    """Replace what stands between the two comments, and nothing else."""
    before, rest = page.read_text(encoding="utf-8").split(begin)
    after = rest.split(end)[1]
    page.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", encoding="utf-8")


def outputs(parser: argparse.ArgumentParser) -> None:
    """Add the options that `deliver` reads."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep the numbers there")
    parser.add_argument("--page", type=Path, metavar="FILE", help="put the tables into that page")


def deliver(given: argparse.Namespace, found: dict[str, Any], text: str, begin: str, end: str) -> None:
    """Print the text, keep the numbers in the file that the options name, and put the text into the page."""
    print(text)
    if given.json:
        given.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    if given.page:
        put(given.page, begin, end, text)


def table(heading: list[str], rows: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in [heading, ["---"] * len(heading), *rows])


def options_table() -> str:
    """The options of the methods that ship, as the table of docs/integrators.md."""
    from kickdrift.integrators.asked import known_options, takers
    from kickdrift.integrators.options import DT
    from kickdrift.integrators.own.registration import REGISTERED

    rows = [[f"`{DT.name}`", DT.words, DT.unit, "", "", DT.help, "all"]]
    for name, option in known_options().items():
        if not (methods := [each for each in takers(name) if each not in REGISTERED]):
            continue
        rows.append(
            [f"`{name}`", option.words, option.unit, defaults(name, methods), option.known, option.help, whose(methods)]
        )
    return table(["option", "type", "unit", "default", "choices", "what it does", "taken by"], rows)


def defaults(name: str, methods: list[str]) -> str:
    """The default of most methods, and those of the others with their names."""
    from kickdrift.integrators import integrator

    found = {method: each.fallback for method in methods for each in integrator(method).options if each.name == name}
    usual = Counter(found.values()).most_common(1)[0][0]
    return ", ".join([usual, *(f"{text} ({method})" for method, text in found.items() if text != usual)])


def whose(methods: list[str]) -> str:
    """Methods by name, or by family where all of a large one are among them."""
    from kickdrift.integrators import INTEGRATORS
    from kickdrift.integrators.own.registration import REGISTERED

    every = [each for name, each in INTEGRATORS.items() if name == each.name and name not in REGISTERED]
    families = {each.family: [other.name for other in every if other.family == each.family] for each in every}
    whole = [family for family, names in families.items() if len(names) > 3 and set(names) <= set(methods)]
    rest = [f"`{name}`" for name in methods if not any(name in families[family] for family in whole)]
    return "all" if len(methods) == len(every) else ", ".join([*(f"family {family}" for family in whole), *rest])


def pair_laws_table() -> str:
    """The pair laws that ship, as the table of docs/system-file.md."""
    from kickdrift import forces
    from kickdrift.forces.pairs.law import PairForce

    laws = [cls for cls in map(forces.__dict__.get, forces.__all__) if issubclass(cls, PairForce)]
    laws = [cls for cls in laws if cls.Parameters._field_defaults]  # tables have numbers instead
    rows = [[f"`{cls.name}`", energy_of(cls), parameters_of(cls), f"`{cls.__name__}`", reach_of(cls)] for cls in laws]
    return table(["`type`", "energy", "parameters and their defaults", "Python: `kd.`", "default cutoff"], rows)


def energy_of(cls: Any) -> str:
    """The first clause of a law's description."""
    return " ".join(cls.__doc__.split()).partition(";")[0].replace("U(r) = ", "").replace("|", "\\|")


def parameters_of(cls: Any) -> str:
    """The parameters of a law, with their kinds and defaults."""
    defaults = cls.Parameters._field_defaults
    kinds = {key: f" ({kind})" for key, kind in cls.dimensions.items()}
    return ", ".join(f"`{key} = {defaults[key]:g}`{kinds.get(key, '')}" for key in cls.Parameters._fields)


def reach_of(cls: Any) -> str:
    """The cutoff of a law where none is given."""
    from kickdrift.forces.pairs.law import DEFAULT_CUTOFF

    law = cls.Parameters()
    reach = getattr(law, "reach", DEFAULT_CUTOFF if hasattr(law, "sigma") else 0.0)
    return f"{reach:.6g} sigma" if reach else "none: give one"


if __name__ == "__main__":
    put(checkout() / "docs" / "integrators.md", BEGIN, END, options_table())
    put(checkout() / "docs" / "system-file.md", LAWS, LAWS_END, pair_laws_table())
