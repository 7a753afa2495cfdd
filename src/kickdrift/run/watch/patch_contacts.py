"""Contacts of a `Collision` among the bodies of a periodic box or of a shear-periodic patch, and their images.

The positions of a run are not wrapped. The search maps the ways of all bodies in a step into the box or patch, adds the
images that reach into it, and searches these bodies as those of open space. A pair is then two bodies i < j and the
image of j that i meets.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import RunError
from kickdrift.model.events.collision import Collision
from kickdrift.model.patch import HERE, BoxImages, Image, Patch, images_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.contacts import Contacts
from kickdrift.run.watch.courses import AHEAD
from kickdrift.run.watch.encounters import contacts
from kickdrift.run.watch.overlaps import boxes, overlapping
from kickdrift.run.watch.span import Part

MOST = 20  # patches or boxes that the ways of a step may cover along one axis

Whole = NDArray[np.int64]


class Crowd(NamedTuple):
    """Bodies in the box or patch and images beside them: their bodies (m,), images (numbers, m) and ways."""

    bodies: Whole
    images: Whole
    y0: Floats
    y1: Floats


def contacts_of(event: Collision, system: System) -> Contacts:
    """The contacts of an event, with those of images if the system has some."""
    return Contacts(event, system) if images_of(system) is None else ImageContacts(event, system)


class ImageContacts(Contacts):
    """Contacts with images. The rows of pairs are two bodies, and the numbers of the second one's image."""

    _images: Patch | BoxImages

    def begin(self, system: System) -> None:
        """Watch these bodies, without any known contact."""
        found = images_of(system)
        assert found is not None
        self._begin_with(system)
        self._sources = self.gm[:0]  # a course leaves the pull of all other bodies to its margin
        self._images, self._many = found, True
        self._take(np.zeros((2 + found.numbers, 0), np.int64), np.zeros(0, np.bool_))

    def _crowded(self, part: Part, h: float, step: int, ahead: float) -> tuple[Crowd, Whole]:
        """Bodies and images that may touch in a step, or in the time ``ahead`` from its start, and the columns (2, P)
        of their pairs. These become the pairs to search."""
        images = self._images
        crowded = crowd_in_patch if isinstance(images, Patch) else crowd_in_box
        crowd = crowded(images, *part, self.radii, step)  # type: ignore[arg-type]
        gm = self.gm[crowd.bodies] if ahead else None
        places = overlapping(crowd.y0, crowd.y1, h, self.radii[crowd.bodies], self._massive[crowd.bodies], gm, ahead)
        places = places[:, places[0] < len(self._system)]  # two images meet as their bodies do
        pairs, places = _once(crowd, places)
        known = set(map(tuple, self._known.T.tolist()))
        touching = np.array([tuple(pair) in known for pair in pairs.T.tolist()] if known else [False] * pairs.shape[1])
        self._take(pairs, touching.astype(np.bool_))
        return crowd, places

    def _found_in(self, part: Part, h: float, step: int) -> int:
        """Search a part of a step. Return the number of pairs in contact."""
        if not (np.isfinite(part.y0).all() and np.isfinite(part.y1).all()):
            return 0
        crowd, places = self._crowded(part, h, step, 0.0)
        radii = self.radii[crowd.bodies]
        return contacts(crowd.y0, crowd.y1, h, places, radii, self._approaching, self._touching, self._rows)

    def _places(self, whole: Part, h: float, step: int) -> tuple[Floats, Floats, Whole, Whole]:
        crowd, places = self._crowded(whole, h, step, AHEAD * h)
        return crowd.y0, crowd.y1, places, crowd.bodies

    def _pairs_at(self, y: Floats, time: float) -> tuple[Floats, Whole, Whole]:
        first, second, *image = self._suspected
        images = y[:, :, second] + self._images.offset(np.array(image), time)
        count = len(first)
        pairs = np.arange(2 * count).reshape(2, count)
        return np.ascontiguousarray(np.concatenate([y[:, :, first], images], axis=2)), pairs, np.append(first, second)

    _newton = True  # crowded patches have many contacts

    def _apart(self, y: Floats, time: float, i: int, j: int, image: Sequence[int]) -> Floats:
        """Relative position and velocity (2, 3) of a body and the image of another one."""
        return y[:, :, i] - y[:, :, j] - self._images.offset(image, time)

    def touch(self, bodies: tuple[int, ...], image: Image = HERE) -> None:
        """Mark two bodies as touching, until they separate."""
        pair = np.array([*bodies, *(image if any(image) else [0] * self._images.numbers)], np.int64)[:, None]
        same = (self._pairs == pair).all(axis=0)
        if same.any():
            self._touching |= same
        else:
            self._take(np.concatenate([self._pairs, pair], axis=1), np.append(self._touching, True))


def crowd_in_box(box: BoxImages, y0: Floats, t0: float, y1: Floats, t1: float, radii: Floats, step: int) -> Crowd:
    """Bodies mapped into the box at t0, and the images that may meet them until t1.

    Raises RunError for ways across many boxes."""
    inverse = np.linalg.pinv(box.edges)  # (3, 3); zeros for axes that are not periodic
    home = -np.floor(inverse.T @ y0[0])
    y0, y1 = (y + box.offset(home, t0) for y in (y0, y1))
    low, high = boxes(y0, y1, t1 - t0, radii)
    middle = inverse.T @ (0.5 * (low + high))
    reach = np.linalg.norm(inverse, axis=0)[:, None] * 0.5 * np.linalg.norm(high - low, axis=0)
    low, high = middle - reach, middle + reach  # in edges
    least, most = low.min(axis=1), high.max(axis=1)
    if not (most - least < MOST).all():
        raise RunError(f"step {step} (t = {t0:.9g}): a body crosses many boxes in one step; take a smaller dt")
    counts = np.where(box.edges.any(axis=1), np.floor(most - least), 0).astype(int)
    shifts = np.array(list(product(*(range(-k, k + 1) for k in counts))))
    shifts = shifts[shifts.any(axis=1)].reshape(-1, 3)[:, :, None]
    which, reaching = np.nonzero(((low + shifts <= most[:, None]) & (high + shifts >= least[:, None])).all(axis=1))
    who = np.concatenate([np.arange(y0.shape[2]), reaching])
    image = np.concatenate([np.zeros(home.shape), shifts[which, :, 0].T], axis=1)
    ways = (np.ascontiguousarray(y[:, :, who] + box.offset(image, t0)) for y in (y0, y1))
    return Crowd(who, (image + home[:, who]).astype(np.int64), *ways)


def crowd_in_patch(patch: Patch, y0: Floats, t0: float, y1: Floats, t1: float, radii: Floats, step: int) -> Crowd:
    """Bodies mapped into the patch at t0, and the images that may meet them until t1.

    Raises RunError for ways across many patches."""
    column = -np.round(y0[0, 0] / patch.width)
    along = y0[0, 1] + patch.offset((column, 0.0), t0)[0, 1]
    home = np.array([column, -np.round(along / patch.length)])
    y0, y1 = y0 + patch.offset(home, t0), y1 + patch.offset(home, t1)
    low, high = (side[:2] for side in boxes(y0, y1, t1 - t0, radii))
    least, most = low.min(axis=1), high.max(axis=1)
    if not ((most - least) / (patch.width, patch.length) < MOST).all():
        raise RunError(
            f"step {step} (t = {t0:.9g}): a body crosses many widths or lengths of the patch in one step; take a "
            f"smaller dt"
        )
    span, shifts = most - least, []
    columns = int(span[0] / patch.width)
    for k in range(-columns, columns + 1):
        begin = k * patch.shear * t0
        base = -round(begin / patch.length)
        shift = begin + base * patch.length
        first, last = sorted((shift, shift + k * patch.shear * (t1 - t0)))
        for row in range(math.ceil((-span[1] - last) / patch.length), math.floor((span[1] - first) / patch.length) + 1):
            if k or row:
                shifts.append((k * patch.width, first, last, row * patch.length, float(k), float(base + row)))
    table = np.array(shifts).reshape(-1, 6).T[:, :, None]
    out, early, late, up = table[:4]
    inside = (low[0] + out <= most[0]) & (high[0] + out >= least[0])
    which, reach = np.nonzero(inside & (low[1] + early + up <= most[1]) & (high[1] + late + up >= least[1]))
    who = np.concatenate([np.arange(y0.shape[2]), reach])
    image = np.concatenate([np.zeros(home.shape), table[4:, which, 0]], axis=1)
    ways = (np.ascontiguousarray(y[:, :, who] + patch.offset(image, t)) for y, t in ((y0, t0), (y1, t1)))
    return Crowd(who, (image + home[:, who]).astype(np.int64), *ways)


def _once(crowd: Crowd, places: Whole) -> tuple[Whole, Whole]:
    """Pairs (4, P) of the bodies at these places (2, Q) of a crowd, each pair once, and one place (2, P) of each."""
    places = places[:, crowd.bodies[places[0]] != crowd.bodies[places[1]]]
    turned = crowd.bodies[places[0]] > crowd.bodies[places[1]]
    places = np.where(turned, places[::-1], places)
    image = crowd.images[:, places[1]] - crowd.images[:, places[0]]
    pairs = np.concatenate([crowd.bodies[places], image])
    order = np.lexsort(pairs[::-1])
    pairs, places = pairs[:, order], places[:, order]
    first = np.append(True, (pairs[:, 1:] != pairs[:, :-1]).any(axis=0))[: pairs.shape[1]]
    return np.ascontiguousarray(pairs[:, first]), np.ascontiguousarray(places[:, first])
