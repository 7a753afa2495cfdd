"""Boxes of any shape: nearest images, wrapping, heights, and refused input."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.nearness import any_nearer, nearest_pair, pairs_nearer
from kickdrift.systemfile.reading import loads

LEANING = [[10.0, 0.0, 0.0], [4.0, 9.0, 0.0], [-3.0, 2.0, 8.0]]
AXES = [axes for axes in itertools.product((True, False), repeat=3) if any(axes)]

tilts = st.sampled_from([-0.5, 0.0, 0.5]) | st.floats(-0.5, 0.5)
edges = st.floats(0.1, 10.0)
matrices = st.builds(
    lambda a, b, c, f, g, h: np.array([[a, 0, 0], [f * a, b, 0], [g * a, h * b, c]]),
    edges, edges, edges, tilts, tilts, tilts,
)  # fmt: skip
vectors = st.lists(st.floats(-30.0, 30.0), min_size=3, max_size=3).map(np.array)


def open_along(matrix: np.ndarray, axes: tuple[bool, bool, bool]) -> np.ndarray:
    """The matrix without tilts along axes that are not periodic."""
    both = np.array(axes)
    return np.where(np.outer(both, both), matrix, np.diag(np.diag(matrix)))


def nearest(box: Box, separation: np.ndarray) -> float:
    """Least distance of 5 x 5 x 5 images by the lattice's shortest vectors, around the image in their cell."""
    rows = box.matrix[list(box.periodic_axes)]
    shortest = box.images.reduced
    whole = np.linalg.lstsq(rows.T, shortest.T, rcond=None)[0]
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-9)  # both are of the same lattice
    assert abs(round(np.linalg.det(whole))) == 1
    begun = separation - np.rint(np.linalg.lstsq(shortest.T, separation, rcond=None)[0]) @ shortest
    steps = np.array(list(itertools.product(range(-2, 3), repeat=len(rows)))) @ shortest
    return float(np.linalg.norm(begun + steps, axis=1).min())


@settings(max_examples=400, deadline=None)
@given(matrices, st.sampled_from(AXES), vectors)
def test_the_minimum_image_is_the_nearest_of_all(matrix, axes, separation):
    box = Box(matrix=open_along(matrix, axes), periodic=axes)
    found = box.minimum_image(separation)
    apart = box.fractional(separation - found)
    whole = np.where(axes, np.rint(apart), 0.0)
    np.testing.assert_allclose(apart, whole, atol=1e-9 * (1 + np.abs(apart).max()))
    assert np.linalg.norm(found) <= nearest(box, separation) * (1 + 1e-9) + 1e-9


@settings(max_examples=200, deadline=None)
@given(matrices, st.sampled_from(AXES), vectors)
def test_wrapping_moves_by_whole_edges_into_the_box(matrix, axes, position):
    box = Box(matrix=open_along(matrix, axes), periodic=axes)
    inside = box.wrap(position[None])[0]
    there, moved = box.fractional(inside), box.fractional(position - inside)
    assert all(-1e-9 <= there[k] <= 1 + 1e-9 for k in range(3) if axes[k])
    np.testing.assert_allclose(moved, np.where(axes, np.rint(moved), 0.0), atol=1e-9 * (1 + np.abs(moved).max()))
    np.testing.assert_allclose(box.cartesian(there), inside, atol=1e-9)


def test_an_upright_box_wraps_and_images_as_its_matrix_does():
    x = np.random.default_rng(1).uniform(-40, 40, (500, 3))
    lengths = (7.0, 8.5, 9.25)
    of_lengths, of_matrix, edges = Box(lengths), Box(matrix=np.diag(lengths)), np.array(lengths)
    assert of_lengths == of_matrix
    assert of_matrix.lengths == lengths
    assert not of_matrix.triclinic
    np.testing.assert_array_equal(of_matrix.wrap(x), x - np.floor(x / edges) * edges)
    np.testing.assert_array_equal(of_matrix.minimum_image(x), x - np.round(x / edges) * edges)
    assert Box(lengths).wrap(np.array([[-1e-20, 0.0, 0.0]])).tolist() == [[0.0, 0.0, 0.0]]


def test_heights_volume_and_area():
    box = Box(LEANING)
    a, b, c = box.matrix
    volume = a @ np.cross(b, c)
    assert box.volume == pytest.approx(volume) == pytest.approx(720.0)
    normals = [np.cross(b, c), np.cross(c, a), np.cross(a, b)]
    np.testing.assert_allclose(box.heights, [volume / np.linalg.norm(normal) for normal in normals], rtol=1e-14)
    assert box.area == pytest.approx(90.0)
    slab = Box((4.0, 5.0, 6.0), periodic=(True, True, False))
    assert slab.heights.tolist() == [4.0, 5.0, np.inf]
    assert slab.volume == np.inf
    assert slab.area == 20.0
    plane = Box([[4.0, 0.0], [2.0, 3.0]])
    assert plane.periodic_axes == (True, True, False)
    assert plane.area == 12.0
    assert plane.triclinic
    assert Box().volume == np.inf
    assert not Box().periodic
    assert Box().lengths is None


@settings(max_examples=100, deadline=None)
@given(matrices, st.integers(0, 10**6), st.lists(st.integers(-3, 3), min_size=3, max_size=3))
def test_any_right_handed_vectors_are_turned_and_reduced(matrix, seed, sheared):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    matrix[2] += sheared[0] * matrix[0] + sheared[1] * matrix[1]
    matrix[1] += sheared[2] * matrix[0]
    box, rotation = Box.from_vectors(matrix @ turn.T)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    whole = box.fractional(matrix @ turn.T @ rotation.T)
    np.testing.assert_allclose(whole, np.rint(whole), atol=1e-8)
    assert abs(round(np.linalg.det(whole))) == 1


def test_vectors_that_stand_right_are_not_turned():
    box, rotation = Box.from_vectors(LEANING)
    assert box == Box(LEANING)
    np.testing.assert_array_equal(rotation, np.eye(3))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"matrix": [[10, 0, 0], [6, 10, 0], [2, -3, 8]]},
            "box: bx = 6 leans too far, over half of ax = 10; the same lattice has the matrix "
            "[[10, 0, 0], [-4, 10, 0], [2, -3, 8]]",
        ),
        ({"matrix": [[10, 0, 0], [4, 10, 0], [2, 17, 8]]}, "cy = 17 leans too far"),
        ({"matrix": [[10, 0, 0], [4, 10, 0], [2, 17, 8]]}, "has the matrix [[10, 0, 0], [4, 10, 0], [4, -3, 8]]"),
        ({"matrix": [[10, 0, 0], [4, 10, 0], [2, 1, 0]]}, "box: the edge vectors are singular"),
        ({"matrix": [[10, 0, 0], [4, 10, 0], [2, 1, -8]]}, "box: the edge vectors are left-handed"),
        ({"matrix": [[0, 10, 0], [10, 0, 0], [0, 0, 8]]}, "box: the edge vectors are left-handed"),
        ({"matrix": [[0, 9, 0], [0, 0, 9], [8, 0, 0]]}, "from_vectors turns it to [[9, 0, 0], [0, 9, 0], [0, 0, 8]]"),
        ({"matrix": [[-9, 0, 0], [1, -9, 0], [0, 0, 8]]}, "lower triangular matrix with a positive diagonal"),
        ({"matrix": [[1, 0], [0, 1, 0], [0, 0]]}, "box: expected a matrix of three rows of three numbers"),
        ({"matrix": [1, 2, 3]}, "box: matrix[0]: expected three numbers, got 1"),
        ({"matrix": [[np.nan, 0, 0], [0, 1, 0], [0, 0, 1]]}, "box: matrix: expected finite numbers"),
        ({"lengths": (1, 2, 3), "matrix": LEANING}, "box: expected lengths or a matrix, got both"),
        ({"lengths": (1, 2, 3, 4)}, "box: expected three edge lengths or None, got 4"),
        ({"lengths": (1, 0, 3)}, "box: edge y must be a positive finite length, got 0"),
        ({"lengths": (1, 2, 3), "periodic": (True, False)}, "box: periodic: expected true or false, or three of them"),
        ({"lengths": (1, 2, 3), "periodic": False}, "periodic is False along each axis"),
        ({"matrix": LEANING, "periodic": (True, True, False)}, "not periodic along z, so edge c must lie along z"),
    ],
)  # fmt: skip
def test_what_is_no_box_is_refused(given, message):
    with pytest.raises(InputError) as refused:
        Box(**given)
    assert message in str(refused.value)
    assert str(refused.value).startswith("box: ")


def test_the_reduced_matrix_of_a_refusal_is_taken():
    with pytest.raises(InputError) as refused:
        Box([[10, 0, 0], [-14, 10, 0], [12, 17, 8]])
    matrix = str(refused.value).split("has the matrix ")[1]
    assert Box(eval(matrix)).volume == pytest.approx(800.0)


def test_a_cutoff_beyond_half_the_least_height_is_refused_with_the_numbers():
    box = Box([[10.0, 0, 0], [5.0, 5.0, 0], [0, 0, 10.0]])
    assert box.heights[0] == pytest.approx(10 / 2**0.5)
    x = np.random.default_rng(1).uniform(0, 10, (4, 3))
    with pytest.raises(InputError, match=r"the box is 5 high between its faces across b, shorter than .* 2 x 3 = 6"):
        kd.System(x, box=box, forces=[kd.LennardJones(cutoff=3.0)])
    kd.System(x, box=box, forces=[kd.LennardJones(cutoff=2.5)])


def test_a_leaning_box_has_no_three_lengths():
    with pytest.raises(InputError, match="three lengths"):
        _ = Box(LEANING).lengths
    with pytest.raises(InputError, match=r"engine x: cannot use a leaning box, .*\[4, 9, 0\]"):
        Box(LEANING).cuboid("engine x")
    with pytest.raises(InputError, match=r"engine x: needs a box periodic along x, y and z; .* only along x and z"):
        Box((1.0, 2.0, 3.0), periodic=(True, False, True)).cuboid("engine x")
    assert Box((1.0, 2.0, 3.0)).cuboid("engine x") == (1.0, 2.0, 3.0)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(AXES), st.sampled_from([LEANING, np.diag([7.0, 8.0, 9.0])]), st.integers(0, 10**6))
def test_near_pairs_are_those_of_nearest_images(axes, matrix, seed):
    box = Box(matrix=open_along(np.array(matrix), axes), periodic=axes)
    x = np.random.default_rng(seed).uniform(-12, 12, (40, 3))
    i, j = np.triu_indices(40, 1)
    r = np.linalg.norm(box.minimum_image(x[i] - x[j]), axis=1)
    limit = 2.0
    assert {tuple(pair) for pair in pairs_nearer(x, box, limit)} == {
        (a, b) for a, b, apart in zip(i.tolist(), j.tolist(), r, strict=True) if apart <= limit
    }
    closest = int(np.argmin(r))
    first, second, distance = nearest_pair(x, box, r[closest] * 1.01)
    assert (first, second) == (i[closest], j[closest])
    assert distance == pytest.approx(r[closest])
    assert nearest_pair(x, box, r[closest] * 0.99) is None
    assert any_nearer(box.wrap(x), box, r[closest] * 1.01)
    few = box.wrap(x[np.unique([first, second, 0, 1])])  # four particles are no crowd
    assert not any_nearer(few, box, r[closest] * 0.99)


FILE = """
units = "lj"
force = [{{type = "lennard-jones", cutoff = 2.5}}]
[particles]
lattice = "fcc"
count = 500
{density}
[box]
{box}
"""


def test_a_system_file_gives_a_matrix():
    text = FILE.format(density="", box="matrix = [[8.0, 0, 0], [4.0, 8.5, 0], [-2.0, 3.0, 9.0]]")
    system = loads(text)
    assert system.box == Box([[8.0, 0, 0], [4.0, 8.5, 0], [-2.0, 3.0, 9.0]])
    inside = system.box.fractional(system.state.positions)
    assert len(system) == 500
    assert inside.min() > 0
    assert inside.max() < 1
    slab = loads(FILE.format(density="density = 0.8", box="lengths = [9, 9, 20]\nperiodic = [true, true, false]"))
    assert slab.box == Box((9.0, 9.0, 20.0), periodic=(True, True, False))
    slab = loads(
        FILE.format(density="", box="matrix = [[9, 0, 0], [4, 9, 0], [0, 0, 20]]\nperiodic = [true, true, false]")
    )
    assert slab.state.positions[:, 2].max() == pytest.approx(20 * 0.95, rel=0.01)
    metal = 'units = "metal"\nforce = []\nparticles = {positions = [[0, 0, 0]], mass = 1.0}\nbox.matrix = '
    assert loads(metal + '[["1 nm", 0, 0], [0, "20 angstrom", 0], ["0.2 nm", 0, 10]]').box.matrix[2].tolist() == [
        2,
        0,
        10,
    ]


@pytest.mark.parametrize(
    ("density", "box", "message"),
    [
        ("", "matrix = [[8, 0, 0], [5, 8, 0], [0, 0, 8]]", "box: bx = 5 leans too far"),
        ("", "matrix = [[8, 0, 0], [4, 8], [0, 0, 8]]", "box: expected a matrix of three rows of three numbers"),
        ("density = 0.8", "matrix = [[8, 0, 0], [4, 8, 0], [0, 0, 8]]", "density: not allowed with box.matrix"),
        ("", "matrix = [[8, 0, 0], [4, 8, 0], [0, 0, 8]]\nlengths = [8, 8, 8]", "expected lengths or matrix, got both"),
        ("", "matrix = [[8, 0, 0], [4, 8, 0], [0, 0, 8]]\nperiodic = false", "box: matrix makes a box periodic"),
        ("density = 0.8", "periodic = [true, 1, true]", "box.periodic[1]: expected true or false, got 1"),
        ("", "matrix = [[4, 0, 0], [2, 8, 0], [0, 0, 8]]", "the box is 3.88057 high between its faces across a"),
    ],
)  # fmt: skip
def test_a_file_s_box_is_checked(density, box, message):
    with pytest.raises(InputError) as refused:
        loads(FILE.format(density=density, box=box))
    assert message in str(refused.value)
