"""Cutoffs and truncations of single pairs of species, beside the oracle, by each way to the pairs."""

from __future__ import annotations

import re

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.pairs.ends import End
from tests.long import rest
from tests.oracle.agreement import assert_right
from tests.systems import liquid

KOB_ANDERSEN = {
    "species": {"A": {"sigma": 1.0, "cutoff": 2.5}, "B": {"epsilon": 0.5, "sigma": 0.88, "cutoff": 2.2}},
    "pairs": {("A", "B"): {"epsilon": 1.5, "sigma": 0.8, "cutoff": 2.0}},
}
APART = {  # each truncation in one force
    "species": {"A": {"truncation": "switch"}, "B": {"cutoff": 2.0, "truncation": "force-shift"}},
    "pairs": {("A", "B"): {"cutoff": 2.2, "truncation": "shift"}, ("A", "C"): {"cutoff": 1.5, "truncation": "cut"},
              ("B", "C"): {"truncation": "switch", "switch_start": 1.9}},
}  # fmt: skip
APART["species"]["C"] = {"sigma": 0.9}


def mixture(force: kd.LennardJones, names: str, n: int = 216) -> kd.System:
    start = liquid(n)
    rng = np.random.default_rng(5)
    species = [names[k % len(names)] for k in rng.permutation(n)]
    return kd.System(
        start.state.positions, start.state.velocities, start.state.masses, start.box, [force], "lj", species=species
    )


@pytest.mark.parametrize(("given", "names"), [(KOB_ANDERSEN, "AB"), rest(APART, "ABC"), rest(APART, "ABCDE")])
def test_pairs_of_species_end_where_they_say(given, names):
    """Two and three species have their numbers in registers, five do not."""
    more = {name: {"sigma": 0.8, "truncation": "switch"} for name in names[3:]}
    pairs = {("B", name): {"truncation": "cut"} for name in names[3:]} | {("C", name): {} for name in names[3:]}
    whole = {**given, "species": given["species"] | more, "pairs": given["pairs"] | (pairs if more else {})}
    if more:
        whole["pairs"] |= {("C", name): {"truncation": "shift", "cutoff": 1.9} for name in more}
    assert_right(mixture(kd.LennardJones(**whole), names))


@pytest.mark.long
def test_pairs_that_are_all_cut_end_where_they_say():
    assert_right(mixture(kd.LennardJones(**KOB_ANDERSEN, truncation="cut"), "AB"))


@pytest.mark.long
def test_pairs_of_species_end_where_they_say_in_mixed_precision():
    system = mixture(kd.LennardJones(**KOB_ANDERSEN), "AB")
    exact, mixed = (BoundForces(system, mixed=each).measure(0.0, system.state.phase) for each in (False, True))
    size = np.abs(exact.accelerations).max()
    assert 0.0 < np.abs(mixed.accelerations - exact.accelerations).max() < 5e-6 * size
    assert abs(mixed.potential - exact.potential) < 1e-6 * abs(exact.potential)


@pytest.mark.long
def test_pairs_with_ends_of_their_own_follow_whole_numbers():
    """The exact leapfrog has a loop of its own over the pairs."""
    system = mixture(kd.LennardJones(**APART), "ABC", 125)
    sims = [kd.Simulation(system, integrator=method, dt=0.002) for method in ("velocity-verlet", "leapfrog-exact")]
    for sim in sims:
        sim.run(steps=20)
    np.testing.assert_allclose(*(sim.system.state.positions for sim in sims), atol=1e-9)


def test_one_end_for_all_is_the_plain_force():
    same = {"A": {"cutoff": 2.0, "truncation": "force-shift"}, "B": {"cutoff": 2.0, "truncation": "force-shift"}}
    plain = kd.LennardJones(cutoff=2.0, truncation="force-shift")
    systems = [mixture(force, "AB") for force in (kd.LennardJones(species=same), plain)]
    found = [BoundForces(system).measure(0.0, system.state.phase) for system in systems]
    assert found[0].potential == found[1].potential
    np.testing.assert_array_equal(found[0].accelerations, found[1].accelerations)


def test_cutoffs_mix_as_sigma_does():
    force = kd.LennardJones(species={"A": {"cutoff": 2.5}, "B": {"cutoff": 2.0}})
    assert force.cutoff == 2.5
    assert force.pair_end("A", "B") == force.pair_end("B", "A") == End(2.25, "shift", None)
    switched = kd.LennardJones(truncation="switch", pairs={("A", "B"): {"cutoff": 2.0}}, species={"A": {}, "B": {}})
    assert switched.pair_end("A", "B") == End(2.0, "switch", 1.6)
    assert switched.ends(["A", "B"]) == {End(2.5, "switch", 2.0), End(2.0, "switch", 1.6)}


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"cutoff": 2.0, "pairs": {("A", "B"): {"cutoff": 2.5}}},
         "cutoff of pair A-B is 2.5, beyond the cutoff 2 of the force"),
        ({"species": {"A": {"cutoff": -1.0}}}, "cutoff of species A must be a positive length, got -1.0"),
        ({"species": {"A": {"truncation": "smooth"}}}, "truncation of species A 'smooth' is not one of cut, shift"),
        ({"pairs": {("A", "A"): {"switch_start": 1.0}}},
         'switch_start of pair A-A goes with truncation "switch" or "potential-switch", not "shift"'),
        ({"truncation": "switch", "pairs": {("A", "A"): {"switch_start": 3.0}}},
         "switch_start of pair A-A must lie between 0 and the cutoff 2.5, got 3"),
        ({"truncation": "cut", "tail": True, "species": {"A": {"truncation": "shift"}}},
         'tail = true completes truncation "cut" or "potential-switch", not "shift" of species A'),
        ({"species": {"A": {"cutof": 2.0}}}, "species A: unknown parameter 'cutof'; expected epsilon, sigma, cutoff"),
    ],
)  # fmt: skip
def test_a_wrong_end_is_one_line_that_names_the_pair(given, text):
    with pytest.raises(InputError, match=re.escape(text)):
        kd.LennardJones(**given)


def test_species_with_truncations_of_different_kinds_need_their_pair():
    force = kd.LennardJones(species={"A": {"truncation": "cut"}, "B": {"truncation": "shift"}})
    with pytest.raises(InputError, match="pair A-B is needed: truncations of different kinds have no mean"):
        mixture(force, "AB")
