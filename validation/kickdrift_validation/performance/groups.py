"""Groups of `kickdrift bench speed`: a system for several programs. Another program is another contestant."""

from collections.abc import Callable
from functools import partial
from math import inf
from typing import Any, NamedTuple

from kickdrift_validation.performance import bodies, crystals, liquids, salts, waters
from kickdrift_validation.performance.batch import SYSTEMS, Together, Whfast512Together, one_by_one
from kickdrift_validation.performance.bodies import Heyoka, Rebound, ReboundTree, Scipy, Whfast512
from kickdrift_validation.performance.crystals import LammpsCrystal
from kickdrift_validation.performance.gromacs import Gromacs
from kickdrift_validation.performance.liquids import Asap, Ase, Lammps, Openmm, liquid
from kickdrift_validation.performance.salts import LammpsSalt
from kickdrift_validation.performance.turns import Runner
from kickdrift_validation.performance.waters import LammpsWater, OpenmmWater, Ours

MERCURY = 0.2408467  # years
MELT, MELT_LARGE = 2000, 500  # steps until the lattice is a liquid


class Contestant(NamedTuple):
    """A program and its options. A slow program has a shorter ``horizon`` and fewer ``starts`` for its errors.

    With ``alone`` a program is only timed. Heat baths have noise of their own, and batches have systems of their own.
    So their paths and energies are not compared."""

    name: str
    make: Callable[[Any], Runner]
    horizon: float = inf
    starts: int = 100
    alone: bool = False


class Goal(NamedTuple):
    """Bound for the ratio of our speed to the speed of ``against``, or of the fastest program whose name begins so.
    With ``error`` our energy error must be no larger."""

    against: str
    at_least: float
    error: bool = False
    ours: str = "kickdrift"


class Group(NamedTuple):
    """Contestants. The first is ours, and all others are compared with it.

    Attributes
    ----------
    name : name for ``--only``
    start : state from which all begin
    unit : unit of the amounts: steps, or time where methods choose their steps
    horizon : amount for the energy errors
    looks : number of samples of the energy, evenly over the horizon
    starts : number of starts that differ by a rounding, for the energy errors
    agree : bound for the difference of positions after ten steps in float64
    overhead : seconds besides the turns
    usual : whether the group runs by default
    """

    name: str
    title: str
    start: Callable[[], Any]
    unit: str
    horizon: float
    contestants: tuple[Contestant, ...]
    goals: tuple[Goal, ...] = ()
    looks: int = 10
    starts: int = 1
    threads: int = 1
    agree: float = 1e-9
    overhead: float = 5.0
    usual: bool = True


class Command(NamedTuple):
    """A command, timed as a whole in its own process, with everything compiled beforehand."""

    name: str
    title: str
    words: tuple[str, ...]
    at_most: float  # seconds
    overhead: float = 10.0
    usual: bool = True


def of_ours(name: str = "kickdrift", **options: Any) -> Contestant:
    return Contestant(name, partial(liquids.kickdrift, **options))


def in_bath(integrator: str, **options: float) -> Contestant:
    """kickdrift with a liquid at constant temperature."""
    make = partial(liquids.in_bath, integrator=integrator, **options)
    return Contestant(f"kickdrift {integrator}", make, alone=True)


def moved_by(integrator: str, name: str = "kickdrift", **options: Any) -> Contestant:
    return Contestant(name, partial(bodies.kickdrift, integrator=integrator, **options))


def rebounds(integrator: str, **settings: Any) -> Contestant:
    return Contestant(f"rebound {integrator}", partial(Rebound, integrator=integrator, **settings))


def on_threads(threads: int) -> tuple[Contestant, ...]:
    """Fast programs for liquids on several threads."""
    return (
        Contestant("LAMMPS omp", partial(Lammps, style="omp", threads=threads)),
        Contestant(f"LAMMPS MPI, {threads} processes", partial(Lammps, style="opt", processes=threads)),
        Contestant("OpenMM", partial(Openmm, threads=threads)),
        Contestant("GROMACS", partial(Gromacs, threads=threads)),
        Contestant("native GROMACS", partial(Gromacs, threads=threads, native=True)),
    )


def leapfrog(count: int, at_least: float, horizon: float, usual: bool = True) -> Group:
    """Direct summation over this number of bodies: the planets, or stars."""
    start = partial(bodies.planets, dt=0.5 / 365.25) if count == 9 else partial(bodies.stars, count)
    title = "Sun and 8 planets, half a day a step" if count == 9 else f"{count} stars, softened"
    return Group(
        f"leapfrog-{count}", f"{title}: direct gravity, leapfrog (drift-kick-drift)", start, "steps", horizon,
        (moved_by("leapfrog-dkd"), rebounds("leapfrog")), (Goal("rebound leapfrog", at_least),), usual=usual,
    )  # fmt: skip


def kepler(coordinates: str, *theirs: Contestant) -> Group:
    past = [Goal(each.name, 1.15) for each in theirs if each.name == "rebound whfast512"]
    return Group(
        f"wisdom-holman-{coordinates.split('-')[-1]}",
        f"Sun and 8 planets, a hundredth of Mercury's period a step: Wisdom-Holman, {coordinates}",
        partial(bodies.planets, dt=MERCURY / 100), "steps", 20_000,
        (moved_by("wisdom-holman", coordinates=coordinates), *theirs),
        (Goal("rebound whfast", 4.0, error=True), *past),
    )  # fmt: skip


def kernel(name: str, there: str) -> Group:
    """Wisdom-Holman maps with a kernel of higher order."""
    return Group(
        f"wisdom-holman-{name}",
        f"Sun and 8 planets, a twentieth of Mercury's period a step: Wisdom-Holman, kernel {name}, corrector 17",
        partial(bodies.planets, dt=MERCURY / 20), "steps", 20_000,
        (
            moved_by("wisdom-holman", kernel=name, corrector=17),
            rebounds("whfast", safe_mode=0, coordinates="jacobi", kernel=there, corrector=17),
        ),
        (Goal("rebound whfast", 4.0, error=True),), usual=False,
    )  # fmt: skip


def threads_gain(count: int) -> Group:
    """Two threads beside one for stars."""
    return Group(
        f"leapfrog-{count}-threads", f"{count} stars, softened: leapfrog on 2 threads", partial(bodies.stars, count),
        "steps", 100, (moved_by("leapfrog-dkd", threads=2), moved_by("leapfrog-dkd", "kickdrift, 1 thread")),
        (Goal("kickdrift, 1 thread", 1.7),), threads=2, usual=False,
    )  # fmt: skip


def tree(count: int, opening_angle: float, at_least: float) -> Group:
    """Stars under trees. rebound has the opening angle. The root mean square of our relative errors is 8e-4, and of
    rebound's errors no less."""
    return Group(
        f"plummer-{count}", f"{count} stars, softened, sorted in space: gravity by a tree, leapfrog, two threads",
        partial(bodies.tree_stars, count), "steps", 2,
        (
            Contestant("kickdrift", partial(bodies.by_tree, accuracy=1e-2, threads=2)),
            Contestant("kickdrift, 1 thread", partial(bodies.by_tree, accuracy=1e-2)),
            Contestant("kickdrift, accuracy 0.001", partial(bodies.by_tree, accuracy=1e-3, threads=2)),
            Contestant("rebound tree, 1 thread", partial(ReboundTree, opening_angle=opening_angle)),
        ),
        (Goal("rebound tree", at_least), Goal("kickdrift, 1 thread", 1.7)),
        looks=2, threads=2, agree=1e-4, overhead=100.0, usual=False,
    )  # fmt: skip


def liquid_threads(side: int, name: str, at_least: float) -> Group:
    """Two threads beside one for a liquid of ``side``^3 particles."""
    return Group(
        f"lj-{name}-threads", f"{side**3:,} Lennard-Jones particles: two threads beside one",
        partial(liquid, side**3, MELT_LARGE, threads=2), "steps", 50,
        (of_ours(threads=2), of_ours("kickdrift, 1 thread")), (Goal("kickdrift, 1 thread", at_least),),
        looks=5, threads=2, overhead=30.0, usual=False,
    )  # fmt: skip


def liquid_mixed(side: int, name: str) -> Group:
    """Mixed precision for a liquid of ``side``^3 particles."""
    return Group(
        f"lj-{name}-mixed", f"{side**3:,} Lennard-Jones particles in mixed precision, one thread",
        partial(liquid, side**3, MELT if side == 10 else MELT_LARGE), "steps", 50,
        (of_ours(), of_ours("kickdrift mixed", precision="mixed"), Contestant("GROMACS", Gromacs)),
        (Goal("kickdrift", 1.5, ours="kickdrift mixed"),), looks=5, overhead=30.0, usual=False,
    )  # fmt: skip


def batches(planets: int) -> Group:
    """Many small planetary systems side by side."""
    theirs = SYSTEMS[planets]
    return Group(
        f"batch-{planets}", f"8 systems of {planets} planets side by side: Wisdom-Holman; steps of all systems",
        partial(int, planets), "steps", 0,
        (
            Contestant("kickdrift", Together, alone=True),
            Contestant("kickdrift, one by one", one_by_one, alone=True),
            Contestant(f"rebound whfast512, {theirs} at once", Whfast512Together, alone=True),
        ),
        (Goal("rebound whfast512", 1.15),), usual=False,
    )  # fmt: skip


def crystal(name: str, system: str, title: str) -> Group:
    """A crystal under a many-body force."""
    return Group(
        name, f"{title}, about 300 K, 1 fs a step, one thread", partial(crystals.settled, system), "steps", 1000,
        (
            Contestant("kickdrift", crystals.kickdrift),
            Contestant("LAMMPS plain", LammpsCrystal),
            Contestant("LAMMPS opt", partial(LammpsCrystal, style="opt")),
            Contestant("LAMMPS opt, skin 0.5", partial(LammpsCrystal, style="opt", skin=0.5)),
            Contestant("LAMMPS omp, skin 0.5", partial(LammpsCrystal, style="omp", skin=0.5)),
        ),
        (Goal("LAMMPS", 1.0),),
    )  # fmt: skip


def salt(count: int) -> Group:
    """Molten salt by Ewald's sum and by a mesh."""
    return Group(
        f"salt-{count}", f"{count} ions of molten salt, 1 fs a step, forces to 1e-4, one thread",
        partial(salts.settled, count), "steps", 200,
        (
            Contestant("kickdrift pme", partial(salts.kickdrift, method="pme")),
            Contestant("kickdrift ewald", partial(salts.kickdrift, method="ewald")),
            Contestant("LAMMPS pppm, 9 angstroms", partial(LammpsSalt, cutoff=9.0)),
            Contestant("LAMMPS pppm, 12 angstroms", partial(LammpsSalt, cutoff=12.0)),
        ),
        (Goal("LAMMPS", 3.0, ours="kickdrift pme"),), agree=1e-4, overhead=30.0, usual=False,
    )  # fmt: skip


def water(molecules: int) -> Group:
    """Rigid water by a mesh. The precision of a row has the error of its forces."""
    return Group(
        f"water-{molecules}", f"{molecules} rigid molecules of SPC/E water, 2 fs a step, forces to 1e-4, one thread",
        partial(waters.settled, molecules), "steps", 0,
        (
            Contestant("kickdrift", Ours, alone=True),
            Contestant("kickdrift mixed", partial(Ours, precision="mixed"), alone=True),
            Contestant("LAMMPS pppm, fix shake", LammpsWater, alone=True),
            Contestant("OpenMM", OpenmmWater, alone=True),
        ),
        (Goal("LAMMPS", 4.0), Goal("OpenMM", 5.0)), overhead=90.0, usual=False,
    )  # fmt: skip


ENTRIES: tuple[Group | Command, ...] = (
    Group(
        "lj-1000", "1000 Lennard-Jones particles, rho* = 0.8442, cut and shifted at 2.5, dt* = 0.005, one thread",
        partial(liquid, 1000, MELT), "steps", 2000,
        (
            of_ours(),
            of_ours("kickdrift mixed", precision="mixed"),
            Contestant("LAMMPS plain", Lammps),
            Contestant("LAMMPS opt", partial(Lammps, style="opt")),
            Contestant("LAMMPS omp", partial(Lammps, style="omp")),
            Contestant("OpenMM", Openmm),
            Contestant("GROMACS", Gromacs),
            Contestant("native GROMACS", partial(Gromacs, native=True)),
            Contestant("GROMACS, default tolerance", partial(Gromacs, tolerance=0.005, interval=20)),
            Contestant("ASAP", Asap),
            Contestant("ASE", Ase, horizon=60),
        ),
        (Goal("LAMMPS", 4.5), Goal("LAMMPS", 5.0, ours="kickdrift mixed"), Goal("ASE", 150.0)), overhead=25.0,
    ),
    Group(
        "lj-1000-baths", "the same 1000 particles at constant temperature, beside constant energy",
        partial(liquid, 1000, MELT), "steps", 2000,
        (
            of_ours(),
            in_bath("baoab", friction=1.0),
            in_bath("nose-hoover", tau=0.5),
            in_bath("csvr", tau=0.5),
            Contestant("LAMMPS opt", partial(Lammps, style="opt")),
            Contestant("fix langevin, LAMMPS plain", partial(Lammps, friction=1.0), alone=True),
            Contestant("fix langevin, LAMMPS opt", partial(Lammps, style="opt", friction=1.0), alone=True),
        ),
        (
            Goal("kickdrift", 0.85, ours="kickdrift baoab"),
            Goal("kickdrift", 0.95, ours="kickdrift nose-hoover"),
            Goal("kickdrift", 0.95, ours="kickdrift csvr"),
            Goal("fix langevin", 3.0, ours="kickdrift baoab"),
        ),
    ),
    Group(
        "lj-1000-threads", "the same 1000 particles on two threads", partial(liquid, 1000, MELT), "steps", 2000,
        (of_ours(threads=2), of_ours("kickdrift, 1 thread"), *on_threads(2)), (Goal("kickdrift, 1 thread", 1.7),),
        threads=2, overhead=12.0,
    ),
    Group(
        "lj-100000", "97,336 Lennard-Jones particles of the same liquid, two threads",
        partial(liquid, 46**3, MELT_LARGE, threads=2), "steps", 50,
        (of_ours(threads=2), of_ours("kickdrift mixed", precision="mixed", threads=2), *on_threads(2)),
        (Goal("LAMMPS", 4.0), Goal("GROMACS", 1.6), Goal("native GROMACS", 1.0),
         Goal("native GROMACS", 1.0, ours="kickdrift mixed")),
        looks=5, threads=2, overhead=60.0,
    ),
    Group(
        "lj-1000000", "10^6 Lennard-Jones particles of the same liquid, two threads",
        partial(liquid, 100**3, MELT_LARGE // 5, threads=2), "steps", 5, (of_ours(threads=2), *on_threads(2)),
        (Goal("LAMMPS", 3.0),), looks=1, threads=2, overhead=300.0, usual=False,
    ),
    liquid_threads(22, "10000", 1.85),
    liquid_threads(46, "100000", 1.9),
    liquid_threads(100, "1000000", 1.9),
    liquid_mixed(10, "1000"),
    liquid_mixed(46, "100000"),
    crystal("copper-864", "copper-864", "864 copper atoms, embedded atom"),
    crystal("silicon-512", "silicon-512", "512 silicon atoms, Stillinger-Weber"),
    crystal("silicon-512-tersoff", "tersoff", "512 silicon atoms, Tersoff"),
    salt(1728),
    salt(8000),
    water(4096),
    leapfrog(9, 1.8, 20_000),
    leapfrog(100, 4.0, 1000, usual=False),
    leapfrog(1000, 4.0, 100),
    leapfrog(4096, 4.0, 20, usual=False),
    threads_gain(1000),
    threads_gain(4096),
    tree(100_000, 0.38, 5.0),
    *(batches(planets) for planets in SYSTEMS),
    kepler(
        "jacobi", rebounds("whfast", safe_mode=0, coordinates="jacobi"), Contestant("rebound whfast512", Whfast512)
    ),
    kepler(
        "democratic-heliocentric", rebounds("whfast", safe_mode=0, coordinates="democraticheliocentric")
    ),
    kernel("lazy", "lazy"),
    kernel("composition", "composition"),
    kernel("modified-kick", "modifiedkick"),
    Group(
        "planets", "Sun and 8 planets, as accurate as float64 allows: methods that choose their steps",
        bodies.planets, "years", 100.0,
        (
            moved_by("gauss-radau15"),
            rebounds("ias15"),
            Contestant("heyoka Taylor", Heyoka),
            Contestant("SciPy DOP853, rtol 1e-13", partial(Scipy, solver="DOP853", rtol=1e-13, atol=1e-15), 5.0, 1),
            Contestant("SciPy LSODA, rtol 1e-12", partial(Scipy, solver="LSODA", rtol=1e-12, atol=1e-14), 5.0, 1),
        ),
        (Goal("rebound ias15", 2.0, error=True), Goal("heyoka", 1.0, error=True)), starts=16, overhead=25.0,
    ),
    Group(
        "outer-planets", "Hairer's outer solar system, the same methods", bodies.outer_planets, "days", 1e6,
        (moved_by("gauss-radau15"), rebounds("ias15"), Contestant("heyoka Taylor", Heyoka)),
        (Goal("rebound ias15", 1.5, error=True),), starts=16, overhead=20.0, usual=False,
    ),
    Command("start-up", "kickdrift run lj-1000 --steps 1", ("run", "lj-1000", "--steps", "1"), 2.5),
)  # fmt: skip
