"""Examples of the help pages, by command: a line to type, and its meaning."""

from __future__ import annotations

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
    ),
    "view": (
        ("kickdrift view run.h5md", "One page for any browser: particles that turn, curves and the report."),
        ("kickdrift view solar-system -o planets.html", "The start of a shipped system."),
        ("kickdrift view run.h5md --colour speed --frames 100", "Coloured by speed, with 100 frames."),
    ),
    "movie": (
        ("kickdrift movie run.h5md run.mp4 --turn 90 --duration 10", "Ten seconds, while the camera turns."),
        ("kickdrift movie planets.h5md planets.gif --elevation 60 --zoom 8", "The inner planets, from above."),
    ),
    "export": (("kickdrift export run.h5md run.xtc --step 10", "Every tenth frame, for GROMACS and MDAnalysis."),),
    "info": (
        ("kickdrift info run.h5md", "The report of a run. --all shows everything that the file holds."),
        ("kickdrift info liquid.toml", "Check a system file without running it."),
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
}
