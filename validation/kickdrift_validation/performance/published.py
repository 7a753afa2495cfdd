"""LAMMPS' own published benchmarks, in LAMMPS and kickdrift, in turns from the same numbers.

    kickdrift bench lammps

The scripts and their files are those of the installed LAMMPS, in its folder ``share/lammps/bench``. LAMMPS runs each
script up to its first step. kickdrift takes the atoms, the bonds and the box from there, and the rhodopsin by
`System.from_lammps`. The rhodopsin has a constant volume here, because `from_lammps` takes no barostat. The potential
energies must agree before the turns begin. LAMMPS runs on one process, with its plain styles and with the style opt;
the faster one counts. Speeds are in processor time. Source: Plimpton 1995, doi:10.1006/jcph.1995.1039;
https://www.lammps.org/bench.html.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.errors import InputError
from kickdrift_validation.performance.turns import Missing, Native, Phase, Ratio, Runner, ratio_of, turns

AGREE = 1e-6  # relative difference of the potential energies
BAROSTAT = re.compile(r"npt (temp \S+ \S+ \S+).*")
STYLES = ("", "opt")
CELLS = 20  # of the lattice along each edge, in the scripts of a crystal
QUIET = ("-log", "none", "-screen", "none", "-nocite")
OUT = {
    "chute": "is out of scope: granular particles with friction",
}


class Published(NamedTuple):
    """A benchmark: its script, and the forces and options with which kickdrift does the same; without ``forces``, the
    script says them."""

    script: str
    units: str
    dt: float
    forces: Callable[[Path], list[Any]] | None
    scaled: str = ""  # script of multiples, if it is another
    options: dict[str, Any] = {"integrator": "velocity-verlet"}  # noqa: RUF012
    factors: tuple[float, float, float] | None = None  # of bonded neighbours' pair forces
    agree: float = AGREE  # less where charges have an error of 1e-4


def _copper(folder: Path) -> list[Any]:
    """Embedded atoms of the table Cu_u3.eam, written in LAMMPS' newer form: r phi = 27.2 0.529 Z^2 in eV angstrom."""
    rows = (folder / "Cu_u3.eam").read_text().splitlines()
    sizes, numbers = rows[2].split(), np.array(" ".join(rows[3:]).split(), dtype=float)
    embedded, charge, density = np.split(numbers, [int(sizes[0]), int(sizes[0]) + int(sizes[2])])
    text = [*3 * ["Cu_u3"], "1 Cu", " ".join(sizes), rows[1]]
    text += [repr(float(each)) for each in (*embedded, *density, *(27.2 * 0.529 * charge**2))]
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / "Cu_u3.eam.alloy"
        path.write_text("\n".join(text) + "\n")
        return [kd.EmbeddedAtom(file=str(path))]


def _chains(folder: Path) -> list[Any]:
    return [kd.Fene(30.0, 1.5, epsilon=1.0, sigma=1.0), kd.LennardJones(cutoff=1.12, truncation="shift")]


BENCHMARKS = {
    "lj": Published("in.lj", "lj", 0.005, lambda folder: [kd.LennardJones(cutoff=2.5, truncation="cut")]),
    "chain": Published(
        "in.chain", "lj", 0.012, _chains, "in.chain.scaled",
        {"integrator": "baoab", "temperature": 1.0, "friction": 0.1, "seed": 1}, (0.0, 1.0, 1.0),
    ),
    "eam": Published("in.eam", "metal", 0.005, _copper),
    "rhodo": Published("in.rhodo", "real", 2.0, None, "in.rhodo.scaled", {}, agree=5e-4),
}  # fmt: skip


class Lammps(Runner):
    """LAMMPS at the first step of a benchmark, of a style: plain ("") or opt."""

    def __init__(self, benchmark: Published, style: str, multiples: Sequence[float]) -> None:
        from kickdrift.forces.external.lammps_library import lammps_class

        self.version, self.style = ENGINES["lammps"].version or "", style
        try:
            made = lammps_class()
        except ImportError as error:
            raise Missing(str(error)) from None
        self.folder, there = bench_folder(), os.getcwd()
        whole = tuple(multiples) == (1.0, 1.0, 1.0)
        script = self.folder / (benchmark.script if whole else benchmark.scaled or benchmark.script)
        self.script = BAROSTAT.sub(r"nvt \1", script.read_text().replace("&\n", " "))
        for axis, each in zip("xyz", multiples, strict=True):
            self.script = re.sub(rf"^(variable\s+{axis} index) .*", rf"\1 {each:g}", self.script, flags=re.MULTILINE)
        sizes = [word for axis, each in zip("xyz", multiples, strict=True) for word in ("-var", axis, f"{each:g}")]
        self.lmp = made(cmdargs=[*QUIET, *sizes, *(["-sf", style] if style else [])])
        os.chdir(self.folder)  # where the script finds its files
        try:
            for line in self.script.splitlines():
                if line.split()[:1] not in (["run"], ["thermo"]):
                    self.lmp.command(line)
            self.lmp.command("thermo_modify norm no")
            self.lmp.command("run 0 post no")
        except BaseException:
            self.lmp.close()
            raise
        finally:
            os.chdir(there)

    @property
    def potential(self) -> float:
        return float(self.lmp.get_thermo("pe"))

    def system(self, benchmark: Published) -> kd.System:
        """The same atoms as a System, with kickdrift's forces."""
        if benchmark.forces is None:
            with tempfile.TemporaryDirectory() as made:
                path = Path(made) / benchmark.script
                path.write_text(re.sub(r"(?<=\s)(?=data\.)", f"{self.folder}{os.sep}", self.script))
                return kd.System.from_lammps(path)
        low, high, *_ = self.lmp.extract_box()
        count, order = self.lmp.get_natoms(), np.argsort(self.lmp.numpy.extract_atom("id")[: self.lmp.get_natoms()])
        x, v = (self.lmp.numpy.extract_atom(key)[:count][order].copy() for key in ("x", "v"))
        mass = float(self.lmp.numpy.extract_atom("mass").ravel()[1])
        topology = None
        if benchmark.factors:
            bonds = self.lmp.numpy.gather_bonds()[:, 1:] - 1
            topology = kd.Topology(bonds=bonds.tolist(), factors=benchmark.factors)
        edges, species = np.subtract(high, low), ["Cu"] * count if benchmark.units == "metal" else None
        return kd.System(
            x - low, v, mass, edges.tolist(), benchmark.forces(self.folder), benchmark.units, species, topology=topology
        )

    def run(self, amount: float) -> float:
        self.lmp.command(f"run {round(amount)} pre no post no")
        return round(amount)

    def phase(self) -> Phase:
        raise NotImplementedError

    def close(self) -> None:
        self.lmp.close()


def bench_folder() -> Path:
    """Folder of the benchmarks in the installed LAMMPS. Raises `Missing` if there is none."""
    import lammps

    folder = Path(lammps.__file__).parent / "share" / "lammps" / "bench"
    if not folder.is_dir():
        raise Missing(f"this LAMMPS has no folder share/lammps/bench; {ENGINES['lammps'].install}")
    return folder


class Found(NamedTuple):
    """One benchmark: steps a second of kickdrift and of LAMMPS' faster style, the ratio over the turns with quartiles,
    and the potential energies of the start, kickdrift's first."""

    name: str
    particles: int
    kickdrift: float
    lammps: float
    style: str
    ratio: Ratio
    energies: tuple[float, float]

    @property
    def cells(self) -> list[str]:
        """One line of the table."""
        ratio, (ours, theirs) = self.ratio, self.energies
        return [
            self.name, f"{self.particles:,}", f"{self.kickdrift:.4g}", f"{self.lammps:.4g} ({self.style or 'plain'})",
            f"{ratio.median:.3g} ({ratio.low:.3g} to {ratio.high:.3g})", f"{abs(ours / theirs - 1.0):.1e}",
        ]  # fmt: skip


COLUMNS = ["benchmark", "atoms", "kickdrift steps/s", "LAMMPS steps/s", "kickdrift over it", "energies differ by"]


def chosen(names: Sequence[str]) -> list[str]:
    """Names of benchmarks, all by default. Raises InputError for an unknown name."""
    for name in names:
        if name not in BENCHMARKS:
            why = f"{name} {OUT[name]}" if name in OUT else f"{name!r} is no benchmark"
            raise InputError(f"bench lammps: {why}; there are: {', '.join(BENCHMARKS)}")
    return list(names or BENCHMARKS)


def check_multiples(name: str, multiples: Sequence[float]) -> None:
    """Refuse multiples that give no whole number of lattice cells, or of copies of the chains, along an edge."""
    parts = 1 if BENCHMARKS[name].scaled else CELLS
    for each in multiples:
        if not (np.isfinite(each) and each > 0 and abs(parts * each - round(parts * each)) < AGREE):
            wanted = "a whole number, 1 or more" if parts == 1 else f"a positive multiple of {1 / parts:g}"
            raise InputError(f"bench lammps: multiples: {name} needs {wanted} along each axis, got {each:g}")


def measure(name: str, multiples: Sequence[float] = (1.0, 1.0, 1.0), count: int = 7, seconds: float = 1.0) -> Found:
    """Measure a benchmark of 32,000 atoms, times the multiples along the axes. Raises `Missing` without LAMMPS, and
    InputError for multiples without a box, and if the potential energies differ."""
    check_multiples(name, multiples)
    benchmark, runners = BENCHMARKS[name], list[Runner]()
    try:
        theirs = list[Lammps]()
        for style in STYLES:
            theirs.append(Lammps(benchmark, style, multiples))
            runners.append(theirs[-1])
        system = theirs[0].system(benchmark)
        sim = kd.Simulation(system, dt=benchmark.dt, threads=1, **benchmark.options)
        energies = sim.energy().potential, theirs[0].potential
        if abs(energies[0] - energies[1]) > benchmark.agree * abs(energies[1]):
            raise InputError(
                f"bench lammps: {name}: potential energies differ: {energies[0]:.9g} and {energies[1]:.9g}"
            )
        ours = Native(sim)
        for runner in (ours, *theirs):
            runner.clock = process_time
        speeds = turns([ours, *theirs], seconds, count)
    finally:
        for runner in runners:
            runner.close()
    fastest = 1 + int(np.argmax(np.median(speeds[:, 1:], axis=0)))
    medians = np.median(speeds, axis=0).tolist()
    ratio = ratio_of(speeds[:, 0], speeds[:, fastest])
    return Found(name, len(system), medians[0], medians[fastest], STYLES[fastest - 1], ratio, energies)
