"""Members of an ensemble: keys, grids, draws and seeds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kickdrift.ensemble.members import members_of, path_of, spelled, with_values
from kickdrift.errors import InputError

FILE = {
    "particles": {"elements": [{"body": "b", "a": 1.0}, {"body": "c", "a": 2.0}], "positions": [[0.0, 1.0]]},
    "force": [{"type": "gravity"}],
    "run": {"dt": 0.1, "steps": 10},
}


@pytest.mark.parametrize(
    ("key", "path"),
    [
        ("dt", ("run", "dt")),
        ("run.dt", ("run", "dt")),
        ("title", ("title",)),
        ("particles.elements[1].a", ("particles", "elements", "1", "a")),
        ("particles.elements[c].a", ("particles", "elements", "c", "a")),
        ("box.lengths[0]", ("box", "lengths", "0")),
        ("particles.positions[0][2]", ("particles", "positions", "0", "2")),
    ],
)
def test_a_key_is_a_path(key, path):
    assert path_of(key) == path


@pytest.mark.parametrize("key", ["", ".a", "a.", "a..b", "a[", "a[]", "a]b", "a[1", 3, None])
def test_no_key(key):
    with pytest.raises(InputError, match="vary: expected a key"):
        path_of(key)


def test_values_are_put_in_their_places_of_a_copy():
    changed = with_values(
        FILE,
        {"particles.elements[c].a": 3.0, "particles.elements[0].e": 0.1, "particles.positions[0][1]": 5.0, "time": 2},
    )
    assert changed["particles"]["elements"] == [{"body": "b", "a": 1.0, "e": 0.1}, {"body": "c", "a": 3.0}]
    assert changed["particles"]["positions"] == [[0.0, 5.0]]
    assert changed["run"] == {"dt": 0.1, "time": 2}  # a time replaces the file's steps
    assert FILE["particles"]["elements"][1] == {"body": "c", "a": 2.0}
    assert FILE["run"]["steps"] == 10
    assert with_values({}, {"dt": 0.2}) == {"run": {"dt": 0.2}}


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("particle.elements[0].a", "there is no 'particle'; did you mean 'particles'?"),
        ("particles.elements[2].a", r"no entry \[2\] in a list of 2"),
        ("particles.elements[d].a", "no entry is named 'd'"),
        ("particles.elements[0]", "is a table, not one value"),
        ("particles.elements", "is a list, not one value"),
        ("run.dt.x", "no table or list holds 'x'"),
        ("force[0].type.x.y", "'x' is inside 'gravity'"),
    ],
)
def test_a_key_that_is_not_there(key, said):
    with pytest.raises(InputError, match=said):
        with_values(FILE, {key: 1.0})


def test_grids_and_draws_as_text():
    assert spelled("a", "1:2:3") == [1.0, 1.5, 2.0]
    assert spelled("n", "10:30:3") == [10, 20, 30]
    assert all(isinstance(value, int) for value in spelled("n", "10:30:3"))
    assert spelled("a", "log:1:100:3") == pytest.approx([1, 10, 100], rel=1e-15)
    assert spelled("a", "leapfrog, yoshida4") == ["leapfrog", "yoshida4"]
    assert spelled("a", "1,2.5,true,2 day") == [1, 2.5, True, "2 day"]
    assert spelled("a", "0.5") == [0.5]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1:2", "expected START:STOP:COUNT"),
        ("1:2:x", "COUNT must be a whole number"),
        ("1:2:0", "COUNT must be a whole number"),
        ("a:2:3", "expected a number, got 'a'"),
        ("1:inf:3", "expected a finite number"),
        ("log:-1:1:3", "log takes positive numbers"),
        ("normal:1", "expected normal:A:B"),
        ("normal:1:-1", "a standard deviation is zero or more"),
        ("uniform:2:1", "the low end before the high end"),
        ("log-uniform:0:1", "log-uniform takes positive numbers"),
    ],
)
def test_what_no_grid_or_draw_is(text, said):
    with pytest.raises(InputError, match=said):
        members_of({"a": text}, 1, 0)


@pytest.mark.parametrize("values", [[], 3.0, "", None, [None], {"a": 1}])
def test_what_no_values_are(values):
    with pytest.raises(InputError, match="vary: a: expected"):
        members_of({"a": values}, 1, 0)


@pytest.mark.parametrize(("replicas", "seed"), [(0, 0), (1.5, 0), (True, 0), (1, -1), (1, 0.5)])
def test_replicas_and_seed_are_whole_numbers(replicas, seed):
    with pytest.raises(InputError, match="expected a whole number"):
        members_of({}, replicas, seed)


def test_every_combination_in_order():
    members = members_of({"a": [1, 2], "b": np.array([0.5, 0.6, 0.7])}, 2, 0)
    assert len(members) == 12
    assert [tuple(member.values.values()) for member in (members[i] for i in range(6))] == [
        (1, 0.5), (1, 0.6), (1, 0.7), (2, 0.5), (2, 0.6), (2, 0.7),
    ]  # fmt: skip
    assert [members[i].replica for i in range(12)] == [0] * 6 + [1] * 6
    assert members[7].values == members[1].values
    assert len({members[i].seed for i in range(12)}) == 12
    with pytest.raises(IndexError):
        members[12]


@given(st.integers(0, 2**64), st.integers(1, 50), st.integers(1, 50), st.data())
def test_a_member_is_the_same_whatever_the_size_of_the_ensemble(seed, few, more, data):
    vary = {"x": "normal:1:2", "y": "log-uniform:1e-3:10", "z": [1, 2]}
    one, other = members_of(vary, few, seed), members_of(vary, few + more, seed)
    number = data.draw(st.integers(0, len(one) - 1))
    assert one[number] == other[number]
    assert 1e-3 <= one[number].values["y"] <= 10
    assert isinstance(one[number].values["x"], float)


def test_seeds_are_those_of_numpys_spawn():
    members = members_of({"x": "uniform:0:1"}, 20, 42)
    drawing, running = np.random.SeedSequence(42).spawn(20)[17].spawn(2)
    assert members[17].seed == running.generate_state(1)[0]
    assert members[17].values["x"] == np.random.Generator(np.random.PCG64(drawing)).uniform(0, 1)


def test_draws_have_their_distributions():
    members = members_of({"u": "uniform:2:4", "n": "normal:3:0.5", "l": "log-uniform:1:100"}, 2000, 1)
    drawn = [members[i].values for i in range(2000)]
    u, n, logs = (np.array([values[key] for values in drawn]) for key in "unl")
    error = 4 / np.sqrt(2000)  # four standard errors
    assert abs(u.mean() - 3) < error * 2 / np.sqrt(12)
    assert abs(n.mean() - 3) < error * 0.5
    assert abs(n.std() - 0.5) < error * 0.5 / np.sqrt(2)
    assert abs(np.log10(logs).mean() - 1) < error * 2 / np.sqrt(12)
    assert abs(np.corrcoef(u, n)[0, 1]) < error
