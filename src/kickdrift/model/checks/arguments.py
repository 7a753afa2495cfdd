"""Messages for wrong arguments of a class, with hints for names of other programs.

A hint says what has such a name here, or what is not there yet. Nothing is renamed silently. Each kind of name has rows
of words, separated by spaces, and a text. A text that ends with a quoted name says that this name is meant; ``{word}``
is the word that the user gave.
"""

import inspect
from functools import cache, wraps
from typing import Any, TypeVar

from kickdrift.errors import InputError
from kickdrift.text import VALUE, clean, suggestion

TEMPERATURE = "methods of constant temperature are baoab, csvr and nose-hoover"
PRESSURE = "methods with a heat bath take pressure and barostat: c-rescale, mtk (with nose-hoover) or monte-carlo"
MINIMISATION = "energy minimisation is no run: kickdrift relax SYSTEM, or Simulation.minimize"
CONSTRAINTS = "for constraints give [[constraint]] or kd.Constraint, see docs/rigid-water.md"
SALTS = "did you mean 'rock-salt' or 'molten-salt'?"
WATER = "did you mean 'water-1000' or 'water-flexible'?"
MANY_BODY = (
    "{word} is not there; the many-body forces are 'eam', 'stillinger-weber' and 'tersoff', and the force 'ase' is any "
    "calculator of ASE"
)
MOLECULES = (
    "files of AMBER, GROMACS and CHARMM, and a .pdb with a force field, load through OpenMM: docs/bring-your-system.md"
)
FORMULA = "{word} is not shipped; kd.pair_law makes the force from its formula, and --load FILE.py brings it"
LIQUIDS = "{word} is no engine yet; 'lammps' and 'openmm' are"
STARS = "{word} is no engine yet; 'rebound' is"
DEVICE = "the engine cuda runs on a graphics processor of NVIDIA"
PROCESSORS = f"{{word}} is no engine; {DEVICE}"

ROWS: dict[str, tuple[tuple[str, str], ...]] = {
    "integrator": (
        ("ias15", "rebound's {word} is 'gauss-radau15' here"),
        ("whfast whfast512", "rebound's {word} is 'wisdom-holman' here"),
        ("whc", "rebound's {word} is 'wisdom-holman' here, with corrector 17"),
        ("whckl", "rebound's {word} is 'wisdom-holman' here, with the kernel lazy and corrector 17"),
        ("whckm", "rebound's {word} is 'wisdom-holman' here, with the kernel modified-kick and corrector 17"),
        ("whckc", "rebound's {word} is 'wisdom-holman' here, with the kernel composition and corrector 17"),
        ("wh wisdomholman mvs", "{word} is 'wisdom-holman' here"),
        ("saba1064 saba864 saba4 saba2 saba(10,6,4) saba(8,6,4)", "{word} is 'saba' here, with its option order"),
        ("mercurius hybrid symba mercury6-hybrid reb-trace", "{word} is 'trace' here"),
        ("janus", "rebound's janus is not there; 'leapfrog-exact' also comes back bit by bit"),
        ("symplectic-epicycle epicycle shearing-sheet", "{word} is 'sei' here, with the force hill"),
        (
            "bs bulirsch-stoer gbs odex taylor heyoka",
            "{word} is not there; 'dop853' and 'gauss-radau15' have high order too",
        ),
        ("rk45 dopri5 dopri dp5 ode45 dormand-prince runge-kutta-fehlberg rkf45", "{word} is 'dormand-prince45' here"),
        ("tsit5", "{word} is not there; 'dormand-prince45' has the same order"),
        ("rk23 bs3 ode23 bogacki-shampine", "{word} is 'bogacki-shampine23' here"),
        ("dop853 dopri8 dop8 dp8 dopri853", "{word} is 'dop853' here"),
        ("vern7 vern9 ode78 ode89", "{word} is not there; 'dop853' has a high order too"),
        ("rk runge-kutta rungekutta runge-kutta4 rk-4 classic-rk4", "{word} is 'rk4' here"),
        ("radau radau5 radauiia5", "{word} is 'radau' here"),
        ("bdf ode15s cvode vode zvode", "{word} is 'bdf' here"),
        ("lsoda odeint ode113 adams", "{word} is 'lsoda' here"),
        ("ode23s rodas rodas4 rodas5 ros34", "{word} is 'rosenbrock' here"),
        ("forward-euler explicit-euler euler-forward", "{word} is 'euler' here"),
        ("implicit-euler euler-backward", "{word} is 'backward-euler' here"),
        ("verlet", "did you mean 'velocity-verlet', or 'stormer-verlet' with two positions and no velocities?"),
        ("vv velocityverlet kdk leapfrog-kdk nve md-vv fix-nve constantvolume", "{word} is 'velocity-verlet' here"),
        ("verletintegrator", "OpenMM's {word} is a leapfrog: 'velocity-verlet' here"),
        ("md leap-frog drift-kick-drift dkd", "{word} is 'leapfrog-dkd' or 'velocity-verlet' here"),
        ("variableverletintegrator leapfrog-variable", "{word} is 'leapfrog-adaptive' here"),
        ("hermite hermite-4", "{word} is 'hermite4' here"),
        ("yoshida", "did you mean 'yoshida4', 'yoshida6' or 'yoshida8'?"),
        ("fr4 forestruth", "{word} is 'forest-ruth' here"),
        ("omelyan", "{word} is 'pefrl' here"),
        ("r-respa rrespa mts multiple-time-step", "{word} is 'respa' here"),
        ("rattle shake settle lincs", CONSTRAINTS),
        ("nvt berendsen nvtberendsen thermostat constantnvt fix-nvt", TEMPERATURE),
        ("nosehoover nosehooverintegrator nose nose-hoover-chain", "{word} is 'nose-hoover' here"),
        ("langevinintegrator fix-langevin", "{word} is 'baoab' here"),
        ("langevinmiddleintegrator langevin-middle sd", "{word} is 'baoa' here"),
        ("bussi v-rescale svr", "{word} is 'csvr' here"),
        ("bd overdamped brownian-dynamics", "{word} is 'brownian' here"),
        (
            "npt nph parrinello-rahman mttk monte-carlo-barostat barostat c-rescale fix-npt nptberendsen",
            PRESSURE,
        ),
        ("minimize minimise cg steep steepest-descent fire l-bfgs lbfgs", MINIMISATION),
    ),
    "force": (
        ("lj lj/cut lennardjones 12-6 lj126 lj12-6", "{word} is 'lennard-jones' here"),
        (
            "wca",
            "{word} is 'weeks-chandler-andersen' here",
        ),
        (
            "coul coul/cut coul/long coul/dsf coulombic electrostatics charge charges ewald reaction-field wolf",
            "{word} is the force 'coulomb' here, or one of its methods",
        ),
        ("lj/cut/coul/long lj/cut/coul/cut", "{word} is two forces here, 'lennard-jones' and 'coulomb'"),
        ("pme spme p3m pppm", "{word} is the force 'coulomb' here, with method = pme"),
        (
            "meam airebo rebo reaxff reax reax/c comb snap ace mace nequip deepmd mlip gap",
            MANY_BODY,
        ),
        ("eam/alloy eam/fs embedded-atom setfl finnis-sinclair", "{word} is 'eam' here"),
        ("sw stillinger", "{word} is 'stillinger-weber' here"),
        ("tersoff/mod tersoff/mod/c tersoff/zbl", "{word} is 'tersoff' here, with entries or a file of that form"),
        ("angle angles", "did you mean 'harmonic-angle' or 'cosine-angle'?"),
        (
            "dihedral dihedrals torsion proper",
            "did you mean 'periodic-dihedral', 'ryckaert-bellemans' or 'opls-dihedral'?",
        ),
        ("opls", "{word} is 'opls-dihedral' here"),
        ("rb rb-torsion multi/harmonic", "{word} is 'ryckaert-bellemans' here"),
        ("improper impropers improper-dihedral", "did you mean 'harmonic-improper' or 'periodic-improper'?"),
        ("cvff improper-periodic", "LAMMPS' {word} is 'periodic-improper' here"),
        ("improper-harmonic", "{word} is 'harmonic-improper' here"),
        ("charmm amber gaff martini tip3p spce", MOLECULES),
        ("buck", "{word} is 'buckingham' here"),
        ("morse", "did you mean 'morse-pair' or 'morse-bond'?"),
        ("soft", "{word} is 'soft-pair' here"),
        ("born born-mayer", "{word} is 'born-mayer-huggins' here"),
        ("screened-coulomb", "{word} is 'yukawa' here"),
        ("soft-sphere inverse-power", FORMULA),
        ("table", "{word} is 'tabulated' here"),
        ("dpd", f"{FORMULA}, but random forces are not there yet"),
        ("newton newtonian gravitation nbody n-body point-mass", "{word} is 'gravity' here"),
        ("tree barnes-hut bh treecode octree fmm", "{word} is 'gravity-tree' here"),
        ("gr gr-potential 1pn pn1 post-newtonian relativity schwarzschild", "{word} is 'relativity-1pn' here"),
        ("gr-full eih einstein-infeld-hoffmann", "{word} is 'relativity-eih' here"),
        ("2.5pn pn25 gravitational-waves radiation-reaction peters", "{word} is 'relativity-2.5pn' here"),
        ("frame-dragging gravitomagnetism", "{word} is 'lense-thirring' here"),
        ("gravitational-harmonics oblateness zonal zonal-harmonics j3 j4 j5 j6", "{word} is 'j2' here"),
        ("tide tides-constant-time-lag hut", "{word} is 'tides' here"),
        ("tides-dynamical", "{word} is not there; 'tides' and 'tides-spin' have a constant time lag"),
        ("radiation radiation-forces poynting-robertson pr-drag light", "{word} is 'radiation-pressure' here"),
        ("yarkovsky yarkovsky-effect outgassing marsden", "{word} is 'non-gravitational' here"),
        (
            "modify-orbits-forces modify-orbits-direct exponential-migration type-i-migration inner-disk-edge damping",
            "{word} is 'migration' here; positive times damp",
        ),
        ("gas-drag-force aerodynamic-drag stokes-drag headwind", "{word} is 'gas-drag' here"),
        ("chandrasekhar", "{word} is 'dynamical-friction' here"),
        ("gas-dynamical-friction", "did you mean 'dynamical-friction' by stars, or 'gas-drag'?"),
        ("central-force power-law", "{word} is 'central-potential' here"),
        (
            "nfw hernquist miyamoto-nagai isochrone halo disc disk bulge bar mwpotential2014 milky-way logarithmic",
            "{word} is a part of the force 'galaxy' here",
        ),
        ("modify-mass mass-loss mass-growth accretion", "{word} is 'mass-change' here"),
        ("stochastic-forces", "{word} is not there; friction with noise belongs to the integrator baoab"),
        ("coriolis tidal hills-equations shearing-box", "{word} is 'hill' here"),
        ("ghost-boxes shear-periodic", "{word} is 'gravity-sheet' here, with the force hill"),
        ("spring", "{word} is 'springs' here"),
        ("bond bonds bond-harmonic harmonicbondforce", "{word} is 'harmonic-bond' here"),
        ("harmonicangleforce angle-harmonic", "{word} is 'harmonic-angle' here"),
        ("fene/expand finite-extensible", "{word} is 'fene' here"),
        ("harmonic", "did you mean 'harmonic-bond' or 'springs' between particles, or 'harmonic-trap' around a point?"),
        ("trap spring/self harmonic-well", "{word} is 'harmonic-trap' here"),
        ("field external constant-force addforce efield uniform gravity-uniform", "{word} is 'uniform-field' here"),
        ("drag friction stokes viscous", "{word} is 'linear-drag' here"),
        ("langevin", "friction with noise belongs to the integrator baoab"),
    ),
    "units": (
        (
            "akma amber charmm kcal/mol",
            "{word} is not there; 'real' is kcal/mol, angstrom and fs; it takes units, such as \"2 fs\"",
        ),
        ("nm kj/mol md openmm", "kJ/mol, nm and ps are 'gromacs' here"),
        ("electron atomic hartree bohr", "{word} is not there; 'metal' takes units, such as \"2 bohr\""),
        ("cgs micro nano", "{word} is not there; 'si' takes quantities with units, such as \"1 cm\" and \"1 g\""),
        ("mks international", "{word} is 'si' here"),
        ("reduced dimensionless natural", "did you mean 'lj', or 'nbody' with G = 1?"),
        ("henon hénon heggie n-body nbody-units", "{word} is 'nbody' here"),
        ("pc parsec cluster clusters", "pc, Myr and Msun are 'stellar' here"),
        ("kpc galaxy gadget gyr myr", "kpc, Myr and Msun are 'galactic' here, and 'stellar' has pc"),
        ("solar heliocentric planetary au au/yr", "{word} is 'astro' here"),
    ),
    "unit": (
        ("ang aa angs", "write 'angstrom'"),
        ("msol m_sun m-sun msolar solmass sunmass", "write 'Msun'"),
        ("mearth m_earth earth_mass earthmass", "write the mass of the Earth as \"5.9722e24 kg\""),
        ("mjup m_jup mjupiter jupiter_mass jupitermass", "write the mass of Jupiter as \"1.89813e27 kg\""),
        ("rsun r_sun solar_radius solarradius", "write the radius of the Sun as \"6.957e8 m\""),
        ("rearth r_earth earth_radius earthradius", "write the radius of the Earth as \"6378.1 km\""),
        ("ha", "write 'hartree'"),
        ("dalton daltons", "write 'Da'"),
        ("tau eps epsilon", 'reduced numbers belong to units = "lj", and have no unit there'),
    ),
    "system": (
        ("kepler ellipse", "did you mean 'two-body', 'kepler-e09' or 'ode-kepler'?"),
        ("lj lj-fluid lj-liquid lj-melt liquid melt fluid", "did you mean 'lj-1000' or 'lj-1000-switch'?"),
        ("three-body threebody 3-body", "did you mean 'figure-eight' or 'pythagorean'?"),
        ("star-cluster cluster globular-cluster galaxy", "did you mean 'plummer-1000' or 'stream'?"),
        ("oscillator harmonic", "did you mean 'ode-harmonic'?"),
        ("water water-1000 spc spce spc/e", WATER),
        ("tip3p tip4p protein lysozyme ubiquitin alanine-dipeptide", MOLECULES),
        ("nacl salt", SALTS),
        ("copper cu", "{word} is 'copper-864' here"),
        ("silicon si", "{word} is 'silicon-512' here"),
    ),
    "engine": (
        ("gromacs gmx namd amber charmm desmond", "{word} is no engine; kickdrift export writes frames for {word}"),
        ("hoomd hoomd-blue espresso espressomd dl-poly tinker jax-md", LIQUIDS),
        ("gadget gadget-2 gadget-4 nbody6 mercury mercury6 phantom swift swiftest amuse", STARS),
        ("gpu nvidia", DEVICE),
        ("opencl hip jax torch pytorch", PROCESSORS),
    ),
    "body": (
        ("m", "{word} is 'mass' here"),
        ("r", "{word} is 'radius' here"),
        ("hash id label", "{word} is 'name' here"),
        ("sma semi-major-axis semimajor-axis", "{word} is 'a' here"),
        ("ecc eccentricity", "{word} is 'e' here"),
        ("i inclination", "{word} is 'inc' here"),
        ("node raan lan ascending-node", "{word} is 'Omega' here"),
        ("w argp peri argument-of-pericentre argument-of-periapsis", "{word} is 'omega' here"),
        ("nu true-anomaly", "{word} is 'f' here"),
        ("ma mean-anomaly", "{word} is 'M' here"),
        ("eccentric-anomaly", "{word} is 'E' here"),
        ("period", "{word} is 'P' here"),
        ("pomega l theta lambda", "{word} is not there; give 'Omega', 'omega' and 'M' or 'f'"),
        ("x y z vx vy vz", "System.with_body takes 'position' and 'velocity', each with three numbers"),
    ),
    "argument": (
        ("rc rcut r-cut rcutoff r-c", "{word} is 'cutoff' here"),
        ("shift shifted smooth switch", "{word} is a kind of 'truncation' here"),
    ),
    "option": (
        ("timestep time-step step stepsize step-size h delta-t deltat tstep", "{word} is 'dt' here"),
        ("nsteps n-steps nstep num-steps numsteps number-of-steps niter iterations maxsteps", "{word} is 'steps' here"),
        (
            "tmax t-max tfinal t-final tend t-end end-time endtime stop-time tstop duration total-time totaltime tspan "
            "t-span length",
            "{word} is 'time' here, and until in Simulation.run",
        ),
        (
            "dump dump-freq dump-every nstxout thermo stride save-every save-interval output-every saveat dtout dt-out "
            "sample-every",
            "{word} is 'every' here",
        ),
        ("tol tolerance reltol relative-tolerance accuracy precision-goal", "{word} is 'rtol' here"),
        ("abstol absolute-tolerance", "{word} is 'atol' here"),
        ("max-dt maxdt dtmax dt-max hmax max-stepsize", "{word} is 'max_step' here"),
        ("method solver algorithm", "{word} is 'integrator' here"),
        ("softening eps soft softening-length", "softening is a parameter of the force 'gravity'"),
        ("cutoff rc rcut r-cut rcutoff", "cutoff is a parameter of the pair force"),
        ("g grav big-g gravitational-constant", "G is a parameter of the force 'gravity'"),
        ("box boxsize box-size periodic", "the box belongs to the system"),
        ("temp t-target", "{word} is 'temperature' here, of methods with a heat bath"),
        ("thermostat nvt langevin nose-hoover", TEMPERATURE),
        ("gamma damping damping-rate friction-coefficient", "{word} is 'friction' here"),
        ("tau-t taut tdamp t-damp", "{word} is 'tau' here"),
        ("npt p-target target-pressure", PRESSURE),
        ("tau-p taup pdamp p-damp", "{word} is 'pressure_tau' here"),
        ("pcouple pcoupltype coupltype", "{word} is 'coupling' here"),
        ("nstpcouple barostat-frequency", "{word} is 'pressure_every' here"),
        ("random-seed rng-seed", "{word} is 'seed' here: kd.load(name, seed), --seed, or seed in [velocities]"),
        ("nthreads n-threads num-threads ncores cores cpus nproc n-jobs njobs omp", "{word} is 'threads' here"),
        ("device platform gpu gpus cuda", DEVICE),
        ("outfile out filename trajectory traj dumpfile", "{word} is 'output' here"),
        ("live imd imd-wait", "{word} follows one run: kickdrift run and kickdrift resume take it"),
        (
            "steps until time every output",
            "{word} belongs to Simulation.run, as in sim.run(2000, every=20, output=\"run.h5md\")",
        ),
    ),
}  # fmt: skip


def other_name(kind: str, word: object) -> str:
    """``; rebound's ias15 is 'gauss-radau15' here`` for a known name of another program, else nothing.

    ``kind`` is a key of ``ROWS``. Upper case, underscores and spaces do not matter.
    """
    if not isinstance(word, str) or len(word) > VALUE:
        return ""
    text = _texts(kind).get(_plain(word))
    return "" if text is None else f"; {text.format(word=clean(word.strip(), VALUE))}"


@cache
def _texts(kind: str) -> dict[str, str]:
    return {_plain(word): text for words, text in ROWS[kind] for word in words.split()}


def _plain(word: str) -> str:
    return "-".join(word.lower().replace("_", "-").split())


Class = TypeVar("Class", bound=type)


def hint(unknown: str, names: list[str]) -> str:
    """Text ``; rc is 'cutoff' here`` or ``; did you mean 'epsilon'?``, else ""."""
    theirs = other_name("argument", unknown)
    return theirs if any(f"{name!r}" in theirs for name in names) else suggestion(unknown, names)


def checked_arguments(cls: Class) -> Class:
    """Class decorator: an unknown, missing or superfluous argument raises InputError, not TypeError.

    The line names the class, the nearest argument, and all arguments."""
    made: Any = cls
    initial = made.__init__
    signature = inspect.signature(initial)
    names = [name for name in signature.parameters if name != "self"]

    @wraps(initial)
    def init(self: Any, *args: Any, **given: Any) -> None:
        try:
            signature.bind(self, *args, **given)
        except TypeError as error:
            unknown = next((key for key in given if key not in names), None)
            what = str(error) if unknown is None else f"no argument {unknown!r}{hint(unknown, names)}"
            raise InputError(
                f"{type(self).__name__}: {what} ({type(self).__name__} takes {', '.join(names)})"
            ) from None
        initial(self, *args, **given)

    made.__init__ = init
    return cls


def misfit(function: Any, *arguments: Any) -> str:
    """The signature of a function that cannot be called with these arguments, as text; "" if it can."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # a builtin without a signature
        return ""
    try:
        signature.bind(*arguments)
    except TypeError:
        return str(signature)
    return ""
