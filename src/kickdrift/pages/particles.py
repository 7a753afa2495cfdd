"""Pages of particles: the liquid that ships, and a user's own system."""

from collections.abc import Mapping
from typing import Any

from kickdrift.errors import InputError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.pairs.lennard_jones import LennardJones
from kickdrift.forces.pairs.lists import with_room
from kickdrift.forces.seam.group import ListedForce
from kickdrift.forces.tables.given import Tables
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.options import Options
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.model.system import System
from kickdrift.pages.module import Module
from kickdrift.systemfile.reading import load
from kickdrift.text import shown
from kickdrift.view.scene import scene_of

MOST = 5000  # particles of a page
MORE_ROOM = 3  # times the room of a list at the start, since a page cannot make it larger
WRITTEN_FIRST = ("near", "rows", "thread_force", "force", "moving")  # arrays of a list that nothing reads before
CUTOFFS = (2.5, 1.12, 3.5)  # of the liquid, in sigma: the first at the start; the second leaves little but repulsion
FRICTION = 1.0  # of the liquid's bath
OTHERS = ("velocity-verlet", "yoshida4", "symplectic-euler")  # methods beside the system's own
KEPLER = "wisdom-holman"
Methods = Mapping[str, Mapping[str, float]]


def liquid_runs(module: Module) -> dict[str, Any]:
    """A Lennard-Jones liquid of 1000 particles with and without a heat bath; names are "method cutoff"."""
    system = page_system("lj-1000")
    methods: Methods = {"velocity-verlet": {}, "baoab": {"temperature": 1.0, "friction": FRICTION}}
    found: dict[str, Any] = {}
    for cutoff in CUTOFFS:
        cut = system.with_forces(LennardJones(cutoff=cutoff, truncation="shift"))  # type: ignore[call-arg]
        found |= {f"{name} {cutoff}": each for name, each in _runs(module, cut, methods).items()}
    return found


def system_runs(system: System, module: Module) -> dict[str, Any]:
    """A user's system by its own method and others, by name."""
    assert system.run is not None
    names = dict.fromkeys([system.run.integrator or OTHERS[0], *OTHERS])
    methods: dict[str, dict[str, float]] = {each: {} for each in names if _kept(each, system)}
    if system.box.periodic and system.degrees_of_freedom and (warmth := _temperature(system)):
        methods["baoab"] = {"temperature": warmth, "friction": 0.01 / _step(system)}
    return _runs(module, system, methods)


def _step(system: System) -> float:
    assert system.run is not None
    assert system.run.dt is not None
    return system.run.dt


def _temperature(system: System) -> float:
    energy = 0.5 * float((system.coherent_masses * system.state.velocities.T**2).sum())
    return 2.0 * energy / (system.degrees_of_freedom * system.units.boltzmann)


def _kept(name: str, system: System) -> bool:
    """Whether a page can take steps by this method: a word of kicks and drifts alone, or Wisdom and Holman's under
    gravity alone."""
    method = INTEGRATORS.get(name)
    if name == KEPLER:
        return len(system.forces) == 1 and isinstance(system.forces[0], Gravity)
    return type(method) is Splitting and not method.further and not method.groups


def page_system(name: str) -> System:
    """A shipped System that a page can hold."""
    system = load(name)
    assert isinstance(system, System)
    return checked_system(name, system)


def checked_system(path: str, system: System) -> System:
    """The System of a file. Raises InputError for what a page cannot hold, with its reason."""
    if len(system) > MOST:
        raise InputError(f"page {shown(path)}: has {len(system):,} particles; a page holds {MOST:,}")
    if system.run is None or system.run.dt is None:
        raise InputError(f"page {shown(path)}: needs dt in its [run]")
    if reason := system.held_by or (system.events and "events") or (system.stages and "stages"):
        raise InputError(f"page {shown(path)}: has {reason}, which a page cannot hold")
    for force in system.forces:
        listed = isinstance(force, Tables) or (isinstance(force, ListedForce) and not isinstance(force, PairForce))
        if listed or not (isinstance(force, PairForce | Gravity) or hasattr(force, "law")):
            raise InputError(
                f"page {shown(path)}: force {force.name!r} stays outside; a page holds pair laws, gravity and laws of "
                "fields"
            )
    system.box.cuboid(f"page {shown(path)}")
    return system


def shown_system(system: System) -> dict[str, Any]:
    """What the page knows beside the runs: a scene for the viewer, the edges of the box, and Boltzmann's constant."""
    scene = scene_of(system, colour="speed" if system.box.periodic else None) | {"notes": []}
    for chunk in scene["chunks"]:
        chunk["ellipses"] = None  # they hold for the start alone
    return {"scene": scene, "edges": system.box.lengths, "boltzmann": system.units.boltzmann, "dt": _step(system)}


def _runs(module: Module, system: System, methods: Methods) -> dict[str, Any]:
    """What a page runs: the System by each of these methods with its options, by the method's name."""
    return {name: run_of(module, system, name, {**options, "dt": _step(system)}) for name, options in methods.items()}


def run_of(module: Module, system: System, name: str, options: dict[str, float]) -> dict[str, Any]:
    """What a page runs: the System by the method of this name, from its start."""
    method, flow = INTEGRATORS[name], ParticleFlow(system, 1, False)
    flow.forces.forces = tuple(map(_roomy, flow.forces.forces))
    y = flow.array(system.state)
    flow.tune(y, options["dt"] / max(1, method.evaluations))
    stepper = method.stepper(flow, method.checked(Options(seed=system.seed or 0, **options), Options()))
    for force in flow.forces.forces:
        if isinstance(force, PairKernel):
            for each in WRITTEN_FIRST:
                getattr(force.pairs, each)[...] = 0  # a page holds no chance numbers
    begin = getattr(stepper, "begin_at", stepper.reset)  # no driver may run here
    begin(y, 0.0, 0)
    return module.runs(system, stepper, flow.forces) | {"options": options}


def _roomy(force: Any) -> Any:
    return with_room(force, MORE_ROOM * force.pairs.near.shape[1]) if isinstance(force, PairKernel) else force
