"""Slabs: boxes that are open along z. Ewald's sum with vacuum between the slab and its images, and a correction.

The box of the sum is the slab's with a longer edge z. The correction makes the field of the slab's dipole that of a
slab in vacuum (Yeh & Berkowitz 1999, doi:10.1063/1.479595). What is left falls as exp(-2 pi gap / L), with the gap
between images and the longest period L of the plane (Arnold, de Joannis & Holm 2002, doi:10.1063/1.1491955).
"""

import math

import numpy as np

from kickdrift.model.box.box import Box

MARGIN = 0.5  # longest periods beyond the gap that the estimate asks for
PLANE = (True, True, False)


def is_slab(box: Box) -> bool:
    """Tell whether a box is periodic along x and y, and open along z."""
    return box.periodic_axes == PLANE


def space_of(box: Box, accuracy: float) -> Box:
    """The box of Ewald's sum for a slab, periodic along three axes. The edge z of ``box`` is the slab's thickness."""
    matrix = box.matrix
    reciprocal = np.linalg.inv(matrix[:2, :2])  # its columns
    vectors = [reciprocal @ (i, j) for i in range(-2, 3) for j in range(-2, 3) if i or j]
    longest = 1.0 / min(float(np.linalg.norm(each)) for each in vectors)
    gap = max(longest * (MARGIN - math.log(accuracy) / (2.0 * math.pi)), 0.5 * float(box.heights.min()))
    matrix[2] = 0.0, 0.0, box.matrix[2, 2] + gap
    return Box(matrix=matrix)
