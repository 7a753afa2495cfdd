"""Steps in the order of the clusters: the same bits as kicks, drifts and copies one after the other."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.bound.forces import most_threads
from kickdrift.forces.pairs import sorted_steps
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.splitting.method import Splitting
from tests.systems import fluid, make_system

STEPS = 60
WORDS = [name for name, row in INTEGRATORS.items() if isinstance(row, Splitting) and not row.particles_only]


def moving(seed: int = 1, n: int = 300, speed: float = 1.0, **options) -> kd.System:
    """Particles of random masses that fly about."""
    rng = np.random.default_rng(seed)
    x, edges = fluid(rng, n)
    still = make_system(x, edges, **options)
    v = speed * rng.normal(size=(n, 3))
    return kd.System(
        x, v, masses=still.state.masses, box=edges, forces=still.forces,
        species=[still.species[k] for k in still.species_index],
    )  # fmt: skip


def after(system: kd.System, method: str, every: int, **options) -> tuple[bytes, int, int]:
    """State after some steps, the number of evaluations, and the number of searches."""
    sim = kd.Simulation(system, method, dt=0.002, **options)
    sim.run(STEPS, every=every)
    stepper = sim.integration.stepper
    return sim.state.phase.tobytes(), stepper.counts.evaluations, sim.integration.flow.forces.list_builds[0]


@pytest.mark.parametrize("method", WORDS)
def test_all_words_have_the_same_bits(method):
    """Looks at every second step leave no room for such steps."""
    few, many = (after(moving(), method, every) for every in (sorted_steps.FEWEST_STEPS - 1, STEPS))
    assert few[:2] == many[:2]
    assert many[2] > 2


@pytest.mark.parametrize("options", [{"threads": 2}, {"precision": "mixed"}, {"threads": 2, "precision": "mixed"}])
@pytest.mark.parametrize("species", [False, True])
def test_threads_precisions_and_species_have_the_same_bits(options, species):
    if options.get("threads", 1) > most_threads():
        pytest.skip("NUMBA_NUM_THREADS allows one thread")
    ends = [after(moving(mixed=species), "velocity-verlet", every, **options) for every in (2, 20, STEPS)]
    assert {end[:2] for end in ends} == {ends[0][:2]}


def test_a_list_without_room_grows_within_such_steps():
    """Particles of an open system fall into a dense drop, and their list needs more room than at the start."""
    rng = np.random.default_rng(7)
    x = 1.6 * np.indices((7, 7, 7)).reshape(3, -1).T + rng.uniform(-0.1, 0.1, (343, 3))
    system = kd.System(x, -1.2 * (x - x.mean(axis=0)), forces=[kd.LennardJones(cutoff=2.5, truncation="shift")])
    few, many = (after(system, "velocity-verlet", every) for every in (2, STEPS))
    assert few == many


def test_a_blow_up_stops_at_the_step_at_which_it_happens():
    """The step and the particles in the message are those of step after step."""
    x, edges = fluid(np.random.default_rng(3), 300)
    v = np.zeros((300, 3))
    v[0] = 3000.0, 0.0, 0.0
    texts = []
    for every in (2, STEPS):
        system = kd.System(x, v, box=edges, forces=[kd.LennardJones(cutoff=2.0, truncation="shift")])
        with pytest.raises(kd.RunError) as caught:
            kd.Simulation(system, "velocity-verlet", dt=0.004).run(STEPS, every=every)
        texts.append(str(caught.value).split(":")[0])
    assert texts[0] == texts[1]
