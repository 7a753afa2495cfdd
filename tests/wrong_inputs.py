# ruff: noqa: E501 — the lines are as users see them
"""What newcomers type wrong, and the line that each gets; a line that ends in … begins so.

Python stands as expressions, commands as argument lists. In expressions, X is the positions of two particles, L the system
lj-1000, B two bodies under gravity. The file mine.toml is FILE.
"""

from __future__ import annotations

FILE = """
units = "lj"

[particles]
positions = [[0, 0, 0], [1.5, 0, 0]]

[box]
lengths = [10, 10, 10]

[[force]]
type = "lennard-jones"

[run]
dt = 0.005
steps = 10
"""

# (expression, line)
PYTHON = [
    (
        'kd.Simulation(PAIR, "shake", dt=0.01)',
        "integrator 'shake' is unknown; for constraints give [[constraint]] or kd.Constraint, see docs/rigid-water.md",
    ),
    (
        "kd.compare(PAIR)",
        "compare: system has no dt in [run], and no method that keeps constraints chooses its step",
    ),
    (
        "kd.Simulation(PAIR, dt=0.01).minimize()",
        "minimize moves particles freely, so it breaks constraints; take sim.equilibrate",
    ),
    (
        "kd.Simulation(PAIR, dt=0.01).equilibrate(1.0, steps=10)",
        "equilibrate: no degree of freedom is left, so the system has no temperature",
    ),
    (
        "kd.compare(kd.System(X, forces=[kd.ReflectingWall((1, 0, 0), (-9, 0, 0))]))",
        "compare: its reference, dop853, integrates a force, and 'reflecting-wall' has none: …",
    ),
    ("kd.System(X, box=10)", "box: expected three edge lengths, got 10; a cube is box=(10, 10, 10)"),
    ("kd.System(X, box=[10])", "box: expected three edge lengths or None, got 1"),
    (
        "kd.System(X, box=(4, 4, 4), forces=[kd.LennardJones()])",
        "lennard-jones: box edge x is 4, shorter than twice the cutoff, 2 x 2.5 = 5",
    ),
    ("kd.System([1, 2, 3])", "positions: expected shape (n, 3) with n >= 1, got (3,)"),
    ("kd.System(X, [[0, 0, 0]])", "velocities: expected shape (2, 3) like the positions, got (1, 3)"),
    ("kd.System(X, mass=2.0)", "System: no argument 'mass'; did you mean 'masses'?…"),
    ("kd.System(X, masses=[1, 2, 3])", "masses: expected one number or 2, got shape (3,)"),
    ("kd.System(X, masses=-1)", "masses: particle 0 has mass -1.0; expected a finite number, zero or more"),
    ("kd.System([[math.nan, 0, 0], [1, 0, 0]])", "positions: particle 0 has nan in x; expected finite numbers"),
    (
        'kd.System(X, units="LJ")',
        "units: expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody, got 'LJ'; did you mean 'lj'?",
    ),
    (
        'kd.System(X, units="akma")',
        "units: expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody, got 'akma'; akma is not there; 'real' is kcal/mol, angstrom and fs; it takes units, such as \"2 fs\"",
    ),
    (
        "kd.System(X, forces=[lambda x: -x])",
        "forces[0]: expected a force, such as kd.LennardJones(cutoff=2.5), got a function; kd.PythonForce(function) makes it a force, see docs/your-own-force.md",
    ),
    (
        'kd.System(X, forces=["lennard-jones"])',
        "forces[0]: expected a force, such as kd.LennardJones(cutoff=2.5), got the name 'lennard-jones'",
    ),
    (
        "kd.System(X, forces=[kd.LennardJones])",
        "forces[0]: expected a force, such as kd.LennardJones(cutoff=2.5), got the class LennardJones; write LennardJones(…)",
    ),
    (
        "kd.System(X, forces=kd.LennardJones())",
        "forces: expected a list of forces, such as [kd.LennardJones(cutoff=2.5)], got LennardJones(cutoff=2.5, truncation='shift', switch_start...",
    ),
    ("kd.System(X, forces=[kd.Restraint(1.0, [7])])", "restraint: particles: there is no particle 7; ids are 0 to 1"),
    (
        "kd.System(X, forces=[kd.ReflectingWall((1, 0, 0), (1, 0, 0))])",
        "reflecting-wall: particle 0 is 1 behind the wall; the normal points to the side of the particles",
    ),
    ("kd.LennardJones(rc=2.5)", "LennardJones: no argument 'rc'…"),
    (
        'kd.LennardJones(truncation="shifted")',
        "lennard-jones: truncation 'shifted' is not one of cut, shift, force-shift, switch, potential-switch",
    ),
    (
        'kd.LennardJones(pairs={"A-B": {"sigma": 1}})',
        "lennard-jones: pairs: expected two names such as ('A', 'B'), got 'A-B'",
    ),
    ('kd.LennardJones(epsilon="1")', "lennard-jones: epsilon must be a finite number, got '1'"),
    ('kd.Gravity(softening="a")', "gravity: softening must be a length, zero or more, got 'a'"),
    (
        "kd.pair_law(EnergyAlone)(cutoff=2.5)",
        "energy-alone: law(p, r2) at the cutoff, r2 = 6.25, must return two numbers, energy and force over r; it returned 0.16",
    ),
    (
        "kd.pair_law(WrongSlope)(cutoff=2.5)",
        "wrong-slope: law(p, r2) must return energy and force over r, -U'(r) / r; at r = 2.375 it returns 0.0314301, and its energy's slope gives 0.0628602",
    ),
    ('B.body("c")', "body: expected a row, 0 to 1, got 'c'; or system['c']"),
    ("B.body(7)", "body: expected a row, 0 to 1, got 7; or system[7]"),
    ('B["Jupitr"]', "system: there is no body 'Jupitr'…"),
    ("kd.Crossing(lambda t, x, v: x[0, 0])", "Crossing: missing a required argument: 'name'…"),
    (
        'B.watched([kd.Crossing(lambda x: x[0, 0], "plane")])',
        "crossing 'plane': function must take (t, x, v); it takes (x)",
    ),
    ('B.watched(["collision"])', "events: expected CloseApproach, Collision, Escape or Crossing, got 'collision'"),
    ('kd.Column("height")', "Column: missing a required argument: 'unit'…"),
    (
        'kd.Simulation("lj-1000")',
        "a Simulation takes a System or a Problem, got 'lj-1000': give kd.load('lj-1000'), or for a run's file kd.resume",
    ),
    ("kd.Simulation(kd.System)", "a Simulation takes a System or a Problem, got the class System"),
    (
        'kd.Simulation(L, "verlett")',
        "integrator 'verlett' is unknown; did you mean …",
    ),
    ('kd.Simulation(L, "ias15")', "integrator 'ias15' is unknown; rebound's ias15 is 'gauss-radau15' here"),
    (
        'kd.Simulation(L, "nvt")',
        "integrator 'nvt' is unknown; methods of constant temperature are baoab, csvr and nose-hoover",
    ),
    ("kd.Simulation(STILL, 'pefrl')", "dt is needed: system 'system' has no dt in [run]"),
    ("kd.Simulation(STILL).run(10)", "dt is needed: system 'system' has no dt in [run]"),
    ("kd.Simulation(STILL).advance(10)", "dt is needed: system 'system' has no dt in [run]"),
    ("kd.Simulation(STILL).steps_to(until=1.0)", "dt is needed: system 'system' has no dt in [run]"),
    ("kd.Simulation(STILL).equilibrate(1.0, steps=10)", "dt is needed: system 'system' has no dt in [run]"),
    ('kd.Simulation(L, dt="fast")', "dt must be a positive finite time, got 'fast'"),
    ("kd.Simulation(L, dt=0)", "dt must be a positive finite time, got 0"),
    (
        "kd.Simulation(L, timestep=3)",
        "timestep: no integrator takes such an option; timestep is 'dt' here; velocity-verlet takes dt, compensated",
    ),
    ("kd.Simulation(L).run()", "run: give either steps or until"),
    ("kd.Simulation(L).run(10.5)", "run: steps must be a whole number, zero or more, got 10.5"),
    (
        "kd.Simulation(L).run(10, interval=0.1)",
        "run: interval is for methods that choose their steps; with velocity-verlet, use every",
    ),
    (
        'kd.Simulation(L).run(10, output="x.dcd")',
        "x.dcd: the name of a run's file must end in .h5md, not '.dcd'; kickdrift export makes such a file from a run's file",
    ),
    ("kd.Simulation(L).run(10, observe=3)", "run: observe must be a function, got 3"),
    ("kd.Simulation(L).equilibrate(-1, 1.0)", "equilibrate: temperature must be positive, got -1"),
    ('kd.Simulation(B, "leapfrog-exact", dt=0.01, rtol=1e-9)', "rtol: leapfrog-exact does not take it; it takes dt"),
    ("kd.Problem(lambda y: y, [1.0])", "problem: f must take (t, y); it takes (y)"),
    ("kd.Problem(lambda t, y: [1, 2], [1.0])", "problem: f must return shape (1,), like y0, got (2,)"),
    ("kd.Problem(lambda t, y: y, 1.0)", "problem: y0 must be one row of numbers, got 1.0; write [1.0]"),
    (
        'kd.Simulation(kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0]), "leapfrog", dt=0.1)',
        "leapfrog: needs accelerations that depend on positions and time alone, and the problem is not declared separable=True; Runge-Kutta methods do not",
    ),
    (
        'kd.load("lj-100")',
        "'lj-100' is neither a file nor a shipped system; did you mean 'lj-1000'? (kickdrift list systems shows all)",
    ),
    ('kd.load("run.h5md")', "'run.h5md' is the file of a run: kd.open(…)[-1].system is the System of its last frame"),
    ('kd.open("lj-1000")', "lj-1000: is a system file, not the file of a run; kickdrift run and kd.load take it"),
    ('kd.open("none.h5md")', "none.h5md: no such file"),
    ('kd.resume("none.h5md")', "none.h5md: no such file"),
    (
        'kd.export("none.h5md", "x.gro")',
        "x.gro: the name of an export must end in .dcd, .xtc, .trr, .xyz, .pdb, .extxyz, .traj, .data, .bin, not '.gro'",
    ),
    ('kd.load("lj-1000", snapshot=1)', "snapshot: is for archives of rebound and snapshots, and …"),
    (
        "kd.frequencies([1.0] * 20, [k * k for k in range(20)])",
        "times: not evenly spaced; the largest departure, at sample 9, is 5 of the spacing",
    ),
    ('kd.analysis.orbit_report("none.h5md", order=0)', "order must be a whole number, one or more, got 0"),
    (
        'kd.Ensemble("lj-1000", {"temprature": [1, 2]}, steps=10)',
        "vary: temprature: there is no such key; did you mean 'temperature'?",
    ),
    (
        "kd.analysis.radial_distribution([[0, 0, 1], [1, 0, 1], [0, 1, 1]], (4, 4, 4))",
        "radial_distribution: all particles have the same z, and spheres around them have no uniform density; run the layer with dimensions = 2 (z constant), or give a Box that is open along z",
    ),
    (
        'kd.register_splitting("mine", word="ABA", order=4, source="me", check_order=True)',
        "mine: the order is stated as 4, but measured as 2.0",
    ),
]

# (arguments, line)
COMMANDS = [
    ("analyze none.h5md", "kickdrift: none.h5md: no such file"),
    (
        "analyze none.h5md --frame sun",
        "kickdrift: --frame: expected one of 'jacobi', 'heliocentric', 'barycentric', got 'sun'…",
    ),
    ("run", "kickdrift: Missing argument 'SYSTEM'…"),
    ("runn", "kickdrift: No such command 'runn'. Did you mean 'run'?…"),
    (
        "run lj-100",
        "kickdrift: 'lj-100' is neither a file nor a shipped system; did you mean 'lj-1000'? (kickdrift list systems shows all)",
    ),
    ("run lj-1000 --steps ten", "kickdrift: --steps: 'ten' is not a whole number, 0 or more…"),
    ("run lj-1000 --steps -1", "kickdrift: --steps: '-1' is not a whole number, 0 or more…"),
    ("bench lammps --seconds inf", "kickdrift: --seconds: 'inf' is no number of seconds, 0.001 or more…"),
    ("bench speed --seconds nan", "kickdrift: --seconds: 'nan' is no number of seconds, 0.001 or more…"),
    ("bench compile --only lj-100", "kickdrift: bench compile: 'lj-100' is unknown; known are lj-1000, lj-1000-mixed…"),
    ("run lj-1000 --steps 10 --time 1", "kickdrift: give --steps or --time, not both"),
    (
        "run lj-1000 --step 10",
        "kickdrift: No such option: --step (Possible options: --max-step, --steps, --store); step is 'dt' here…",
    ),
    ("run lj-1000 --dt '5 parsecs'", "kickdrift: dt: lj quantities are plain numbers, got '5 parsecs'"),
    (
        "run lj-1000 --integrator verlett",
        "kickdrift: integrator 'verlett' is unknown; did you mean …",
    ),
    (
        "run lj-1000 --engine gromacs",
        "kickdrift: engine 'gromacs' is not one of native, ase, rebound, lammps, openmm, cuda; gromacs is no engine; kickdrift export writes frames for gromacs",
    ),
    (
        "run lj-1000 --steps 1 --output x.dcd",
        "kickdrift: --output x.dcd: the name must end in .h5md, .h5, .csv, .parquet, not '.dcd'; kickdrift export makes such a file from a run's file",
    ),
    (
        "run mine.toml -o corector=17",
        "kickdrift: corector: no integrator takes such an option; did you mean 'corrector', which wisdom-holman takes?",
    ),
    ("run mine.toml -o corrector", "kickdrift: -o: expected KEY=VALUE, such as corrector=17, got 'corrector'"),
    (
        "list integrator",
        "kickdrift: WHAT: expected one of 'integrators', 'forces', 'systems', 'engines', got 'integrator'…",
    ),
    ("list integrators foo", "kickdrift: integrator 'foo' is unknown; did you mean obabo, oabao?"),
    (
        "plot mine.toml",
        "kickdrift: mine.toml: is a system of particles; run it with --output run.h5md and plot that file",
    ),
    ("plot none.h5md", "kickdrift: none.h5md: no such file"),
    (
        "export mine.toml y.dcd",
        "kickdrift: mine.toml: is a system file, not the file of a run; kickdrift run and kd.load take it",
    ),
    (
        "resume mine.toml",
        "kickdrift: mine.toml: is a system file, not the file of a run; kickdrift run and kd.load take it",
    ),
    ("info none", "kickdrift: 'none' is neither a file nor a shipped system (kickdrift list systems shows all)"),
    ("compare mine.toml --accuracy tight", "kickdrift: --accuracy: expected a number…"),
    ("ensemble mine.toml --vary a=b --steps 1", "kickdrift: mine: a: unknown key…"),
]

# (text in FILE, what stands in its place, line)
FILES = [
    ('units = "lj"', 'unit = "lj"', "system: unit: unknown key; did you mean 'units'?…"),
    (
        'units = "lj"',
        'units = "akma"',
        "system: units: expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody, got 'akma'; akma is not there; 'real' is kcal/mol, angstrom and fs; it takes units, such as \"2 fs\"",
    ),
    ('units = "lj"', 'seed = 3\nunits = "lj"', "system: seed: unknown key; did you mean velocities.seed?…"),
    ("lengths", "length", "system: box.length: unknown key; did you mean 'lengths'?…"),
    (
        'type = "lennard-jones"',
        'type = "LJ"',
        "system: force[0].type: expected one of lennard-jones, mie, weeks-chandler-andersen, buckingham, born-mayer-huggins, morse-pair, …",
    ),
    ('type = "lennard-jones"', 'type = "lennard-jones"\nrc = 2.5', "system: force[0].rc: unknown key…"),
    ("dt = 0.005", 'dt = "0.005 fs"', "system: run.dt: lj quantities are plain numbers, got '0.005 fs'"),
    ("dt = 0.005", "timestep = 0.005", "system: run.timestep: unknown key; timestep is 'dt' here…"),
    ("steps = 10", "steps = 10\ntime = 1", "system: run: expected steps or time, got both"),
    ("[1.5, 0, 0]", "[0, 0, 0]", "system: positions: particles 0 and 1 are at the same place, distance 0"),
    ("steps = 10", "steps = 1e6", "system: run.steps: expected a whole number, got 1000000.0"),
    ("[run]", "[runs]", "system: runs: unknown key; did you mean 'run'?…"),
]
