"""Help pages of the commands: plain text of at most 80 columns, options in groups, then examples."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any

from typer.core import TyperCommand, TyperGroup

from kickdrift.cli.console import WIDE, width_of
from kickdrift.display import layout
from kickdrift.integrators.asked import known_options
from kickdrift.integrators.options import DT, MIXED

INTEGRATOR, PACE, REST = "Integrator", "Pace", "Options"
# Options by name; an option of an integrator is in the group INTEGRATOR, and every other option in the last group.
# The group PACE is for films.
GROUPS: dict[str, tuple[str, ...]] = {
    "How long": ("steps", "time", "exact", "length"),
    PACE: ("fps", "duration", "every"),
    INTEGRATOR: ("integrator", "accuracy", DT.name, MIXED, "o"),
    "Camera": ("azimuth", "elevation", "turn", "zoom", "colour", "size", "dark"),
    "Start": ("seed", "equilibrate", "vary", "replicas", "measure"),
    "Output": (
        "output", "every", "interval", "write", "store", "compress", "flush", "trajectories", "json_file", "plot",
        "overwrite", "quiet",
    ),
    "Machine": ("threads", "engine", "processes", "hosts", "workers", "scheduler"),
    "Watching": ("live", "imd", "imd_wait"),
    REST: (),
}  # fmt: skip
FEW = 9  # options that need no groups
COLUMN = 24  # where the help of an option begins


# Values of options that may stand without a value, by the word on the command line.
ALONE = {"--imd": "8888", "--live": "0"}


class _Paged:
    """A command with a help page of kickdrift's own."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help page."""
        formatter.write("\n".join(_page(self, ctx, _width())) + "\n")


class Command(_Paged, TyperCommand):
    """A command of kickdrift."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; an option of ``ALONE`` takes the next word only if that is a number."""
        known = {word: ALONE[word] for option in self.params for word in option.opts if word in ALONE}
        given = [
            f"{word}={known[word]}" if word in known and not (after.isascii() and after.isdigit()) else word
            for word, after in zip(args, [*args, ""][1:], strict=True)
        ]
        parsed: list[str] = super().parse_args(ctx, given)
        return parsed


class Group(_Paged, TyperGroup):
    """Commands, whose help page is shown without a command too."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; without any, show the help page and end with exit status 2."""
        if not args and not ctx.resilient_parsing:
            print(ctx.get_help())
            ctx.exit(2)
        parsed: list[str] = super().parse_args(ctx, args)
        return parsed


def pages(command: Any, name: str, width: int = WIDE, parent: Any = None) -> Iterator[tuple[str, str]]:
    """Name and help page of a command and of every command inside it."""
    with command.make_context(name, [], parent=parent, resilient_parsing=True) as ctx:
        yield ctx.command_path, "\n".join(_page(command, ctx, width))
        for word, inner in _commands(command):
            yield from pages(inner, word, width, ctx)


def _width() -> int:
    return min(width_of(sys.stdout) or WIDE, WIDE)


def _page(command: Any, ctx: Any, width: int) -> list[str]:
    """Lines of a command's help page."""
    shown = [each for each in command.get_params(ctx) if not getattr(each, "hidden", False)]
    arguments = [each for each in shown if each.param_type_name == "argument"]
    options = [each for each in shown if each.param_type_name == "option"]
    inner = _commands(command)
    usage = [ctx.command_path, *(["[OPTIONS]"] if options else []), *map(_usage, arguments)]
    usage += ["COMMAND [ARGUMENTS]"] if inner else []
    lines = layout.folded(f"Usage: {' '.join(usage)}", width)
    for paragraph in inspect.cleandoc(command.help or "").split("\n\n"):
        lines += ["", *layout.folded(" ".join(paragraph.split()), width)]
    lines += _section("Commands", ((word, _summary(each)) for word, each in inner), width)
    lines += _section("Arguments", ((_metavar(each), _help(each)) for each in arguments), width)
    grouped = _grouped(options) if len(options) > FEW else {REST: options}
    for title, members in grouped.items():
        lines += _section(title, ((_flags(each), _help(each)) for each in members), width)
    if examples := EXAMPLES.get(ctx.command_path.partition(" ")[2], ()):
        lines += ["", "Examples:"]
        for line, about in examples:
            lines += [f"  {line}", *(f"      {each}" for each in layout.folded(about, width - 6))]
    return lines


def _commands(command: Any) -> list[tuple[str, Any]]:
    found = getattr(command, "commands", {})
    return [(word, each) for word, each in found.items() if not each.hidden]


def _section(title: str, rows: Iterable[tuple[str, str]], width: int) -> list[str]:
    lines = [line for key, text in rows for line in layout.beside(layout.INDENT + key, text, COLUMN, width)]
    return ["", f"{title}:", *lines] if lines else []


def _grouped(options: Iterable[Any]) -> dict[str, list[Any]]:
    """The options by group. Groups and their options are in the order of the table, and the rest as declared."""
    of_methods, options = known_options(), list(options)
    films = any(each.name == GROUPS[PACE][0] for each in options)
    found: dict[str, list[Any]] = {title: [] for title in GROUPS if films or title != PACE}
    for each in options:
        title = next((title for title in found if each.name in GROUPS[title]), REST)
        found[INTEGRATOR if title == REST and each.name in of_methods else title].append(each)
    for title, members in found.items():
        names = GROUPS[title]
        if title != INTEGRATOR:
            members.sort(key=lambda each, names=names: names.index(each.name) if each.name in names else len(names))  # type: ignore[misc]
    return {title: members for title, members in found.items() if members}


def _summary(command: Any) -> str:
    """The first sentence of a command's help."""
    text = " ".join((command.help or "").split())
    return re.split(r"(?<=\.)\s", text, maxsplit=1)[0]


def _metavar(parameter: Any) -> str:
    name: str = parameter.metavar or parameter.name.upper()
    return name


def _usage(argument: Any) -> str:
    name = _metavar(argument) + ("..." if argument.nargs != 1 else "")
    return name if argument.required or name.startswith("[") else f"[{name}]"


def _flags(option: Any) -> str:
    """The names of an option, short ones first, and the word for its value."""
    names = sorted(option.opts, key=lambda name: name.startswith("--"))
    if option.secondary_opts:
        return f"{', '.join(names)} / {', '.join(option.secondary_opts)}"
    return ", ".join(names) + ("" if option.is_flag else f" {_metavar(option)}")


def _help(parameter: Any) -> str:
    """The help, with the default that it does not state."""
    text, default = parameter.help or "", parameter.default
    plain = isinstance(default, str | int | float) and not isinstance(default, bool) and str(default)
    if plain and not getattr(parameter, "is_flag", False) and "default" not in text.lower():
        text = f"{text.rstrip('.')} (default {default})."
    if isinstance(parameter.envvar, str):
        text += f" The variable {parameter.envvar} sets the same."
    return text


EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "": (
        ("kickdrift run lj-1000 --steps 2000 --output run.h5md", "Run a shipped system and keep the run in a file."),
        ("kickdrift info run.h5md", "Say what the file holds and how well the run went."),
        ("kickdrift list integrators", "List the integrators."),
    ),
    "run": (
        ("kickdrift run lj-1000 --steps 2000 --output run.h5md", "A shipped system. The file keeps the run."),
        ("kickdrift run liquid.toml --dt 0.002 --time 10", "Your own system file, with another step and length."),
        ("kickdrift run sun-jupiter --integrator wisdom-holman -o corrector=17", "Another method, with an option."),
        ("kickdrift run ode-kepler --integrator dop853 --rtol 1e-10", "An ODE. The method chooses its steps."),
        ("kickdrift run nvt.h5md --integrator velocity-verlet", "A new run from the last frame of another run."),
        ("kickdrift run lj-1000 --engine lammps --threads 2", "The same system in another program."),
        ("kickdrift run two-body --json - --quiet", "The report as one JSON object on standard output."),
    ),
    "resume": (
        ("kickdrift resume run.h5md", "Finish a run that was stopped or killed."),
        ("kickdrift resume run.h5md --steps 40000", "Extend a finished run to step 40,000."),
    ),
    "relax": (
        ("kickdrift relax random.toml --output relaxed.toml", "Move overlapping particles apart, to a minimum."),
        ("kickdrift relax lj-binary-1000 --force 1e-3 --method l-bfgs", "Another tolerance and method."),
    ),
    "ensemble": (
        ("kickdrift ensemble lj-1000 --replicas 8 --steps 2000 --output liquids.parquet", "Eight seeds."),
        ("kickdrift ensemble two-body --vary dt=log:0.001:0.1:5", "Five steps, evenly spaced in the logarithm."),
    ),
    "compare": (
        ("kickdrift compare ode-kepler", "Error and cost of the usual methods."),
        ("kickdrift compare ode-kepler --accuracy 1e-6", "Recommend a method and a step for this accuracy."),
        ("kickdrift compare two-body --integrator leapfrog --integrator rk4", "Two methods."),
    ),
    "compare-engines": (
        ("kickdrift compare-engines kremer-grest-1000", "The forces of one system here, in LAMMPS and in OpenMM."),
    ),
    "chaos": (("kickdrift chaos figure-eight", "MEGNO and the Lyapunov exponent of the figure-eight orbit."),),
    "transits": (
        ("kickdrift transits trappist-1 b --until '20 day' --direction 0,-1,0", "Transit times of a planet."),
    ),
    "certify": (
        ("kickdrift certify silicon-512", "Are the forces of a system safe for dynamics?"),
        ("kickdrift certify cu.xyz --calculator ase.calculators.emt.EMT", "An ASE calculator on a structure's atoms."),
        ("kickdrift certify cold.h5md hot.h5md", "Does a heat bath sample the canonical ensemble?"),
    ),
    "analyze": (
        ("kickdrift analyze run.h5md", "Proper frequencies, secular periods and resonances of a run's orbits."),
        ("kickdrift analyze run.h5md --plot modes.png --json modes.json", "Also as a figure, and as one JSON object."),
    ),
    "plot": (
        ("kickdrift plot run.h5md", "Orbits under gravity, else energies."),
        ("kickdrift plot run.h5md --kind rdf --output rdf.png", "The radial distribution function."),
        ("kickdrift plot --stability rk4 --stability yoshida6", "Stability regions, without a run."),
        ("kickdrift plot Cu.eam.alloy", "A potential's file: energies of crystals, densities, embedding energies."),
    ),
    "view": (
        ("kickdrift view run.h5md", "One page for any browser: particles that turn, curves and the report."),
        ("kickdrift view solar-system -o planets.html", "The start of a shipped system."),
        ("kickdrift view run.h5md --colour speed --frames 100", "Coloured by speed, with 100 frames."),
    ),
    "page": (("kickdrift page which-integrator", "Two methods side by side, computed in the browser."),),
    "movie": (
        ("kickdrift movie run.h5md run.mp4 --turn 90 --duration 10", "Ten seconds, while the camera turns."),
        ("kickdrift movie planets.h5md planets.gif --elevation 60 --zoom 8", "The inner planets, from above."),
    ),
    "export": (
        ("kickdrift export run.h5md run.xtc --step 10", "Every tenth frame, for GROMACS and MDAnalysis."),
        ("kickdrift export lj-1000 in.liquid", "A system as an input of LAMMPS."),
    ),
    "info": (
        ("kickdrift info run.h5md", "The report of a run. --all shows everything that the file holds."),
        ("kickdrift info liquid.toml", "Check a system file without running it."),
        ("kickdrift info Cu.eam.alloy", "Elements, cutoff and crystals of a potential's file."),
    ),
    "list": (
        ("kickdrift list integrators", "Every integrator."),
        ("kickdrift list integrators wisdom-holman", "One integrator and its options."),
        ("kickdrift list systems --json -", "The table as JSON on standard output."),
    ),
    "new": (
        ("kickdrift new", "Write liquid.toml, with a comment on each choice."),
        ("kickdrift new planets --output mine.toml", "A star with planets, under another name."),
    ),
    "schema": (("kickdrift schema > system-file.schema.json", "The schema, beside your own system files."),),
    "cite": (
        ("kickdrift cite run.h5md > run.bib", "The method, the forces and the system of a run."),
        ("kickdrift cite nose-hoover", "One method."),
    ),
    "doctor": (("kickdrift doctor", "What is installed here, and what is missing."),),
    "show": (("kickdrift show lj-1000 > mine.toml", "A copy of a shipped system, to edit."),),
    "validate": (
        ("kickdrift validate --list", "List the scripts."),
        ("kickdrift validate butcher-tableaus", "Run one script."),
    ),
    "bench lj-energy": (
        ("kickdrift bench lj-energy --plot errors.png", "The short benchmark, with a figure."),
        ("kickdrift bench lj-energy --steps 1000000", "The full benchmark, which takes hours."),
    ),
    "bench speed": (("kickdrift bench speed --only lj-1000", "One group of programs."),),
    "bench lammps": (("kickdrift bench lammps --only chain", "LAMMPS' benchmark of bead-spring chains."),),
    "bench compile": (("kickdrift bench compile --only lj-1000", "Seconds, functions and LLVM's share."),),
}
