"""The images of a System's bodies: those of a periodic box, and those of a shear-periodic patch, which move."""

from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.state import Floats

Image = tuple[int, ...]  # of a patch: columns outwards along x, rows along y; of a box: whole edges
HERE: Image = (0, 0)


class Patch(NamedTuple):
    """A patch that repeats along x and y, with images that move with the shear.

    The image (k, l) of a body lies k widths further out and l lengths further along the orbit, less the shear since
    t = 0 (Wisdom & Tremaine 1988, doi:10.1086/114690).
    """

    omega: float
    width: float
    length: float

    @property
    def numbers(self) -> int:
        """How many numbers an image has."""
        return 2

    @property
    def moves(self) -> bool:
        """Whether images move relative to their bodies."""
        return True

    @property
    def shear(self) -> float:
        """Speed along y of the next column outwards."""
        return -1.5 * self.omega * self.width

    def offset(self, image: Any, time: float) -> Floats:
        """Position and velocity (2, 3) of an image relative to its body; of images (2, m), (2, 3, m)."""
        k, row = image
        along, none = k * self.shear * time + row * self.length, 0.0 * k
        return np.array([[k * self.width, along, none], [none, k * self.shear, none]])

    def folded(self, positions: Floats, velocities: Floats, times: Any) -> tuple[Floats, Floats]:
        """Positions and velocities (…, n, 3) of the images inside the patch, at ``times`` (…)."""
        k = np.floor(positions[..., 0] / self.width + 0.5)
        time = np.asarray(times)[..., None]
        along = positions[..., 1] - k * self.shear * time
        row = np.floor(along / self.length + 0.5)
        x, y, none = k * self.width, k * self.shear * time + row * self.length, np.zeros_like(k)
        shift, kick = np.stack([x, y, none], axis=-1), np.stack([none, k * self.shear, none], axis=-1)
        return positions - shift, velocities - kick


def patch_of(system: Any) -> Patch | None:
    """The patch of a System, or None. Its forces declare it."""
    laws = (force.law for force in system.forces if hasattr(getattr(force, "Parameters", None), "patch"))
    return next((law.patch() for law in laws), None)


class BoxImages(NamedTuple):
    """A periodic box, whose image (k, l, m) of a body lies so many edges further."""

    edges: Floats  # (3, 3) as rows; zeros along axes that are not periodic

    @property
    def numbers(self) -> int:
        """See `Patch`."""
        return 3

    @property
    def moves(self) -> bool:
        """See `Patch`."""
        return False

    def offset(self, image: Any, time: float) -> Floats:
        """Position and velocity (2, 3) of an image relative to its body; of images (3, m), (2, 3, m)."""
        shift = self.edges.T @ np.asarray(image, float)
        return np.stack([shift, np.zeros_like(shift)])


def images_of(system: Any) -> Patch | BoxImages | None:
    """The images of a System's bodies; None in open space."""
    if not system.box.periodic:
        return patch_of(system)
    return BoxImages(np.where(np.array(system.box.periodic_axes)[:, None], system.box.matrix, 0.0))


def check_patch(kind: str, patch: Patch, radii: Floats) -> None:
    """Refuse a patch in which a body could touch an image of itself, or two images of another body at once."""
    reach = 4.0 * float(radii.max(initial=0.0))
    for key, size in (("width", patch.width), ("length", patch.length)):
        if size <= reach:
            raise InputError(
                f"{kind}: the patch has the {key} {size:g}; it must exceed 4 radii of the largest body, {reach:g}"
            )
