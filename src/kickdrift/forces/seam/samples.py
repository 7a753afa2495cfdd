"""Samples that cost little: the evaluation before a sample carries energy and virial along.

A force counts its evaluations from one sample to the next, and expects the next sample after as many. The last
evaluation before then sums energy and virial too. The sample takes these sums, if its positions are those of the
evaluation. Forces have the same bits with and without sums, so a sample changes nothing in a run.

A force takes part if its parts have ``looks``, an array of the slots below.
"""

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import jit

# evaluations since the last sample, evaluations between the two samples before, whether the last evaluation had sums,
# whether its accelerations were added up
SINCE, BETWEEN, WITH_SUMS, SUMMED = range(4)


def no_looks() -> NDArray[np.int64]:
    """What is known of samples before the first."""
    return np.zeros(4, np.int64)


@jit
def sums_expected(looks, wanted):
    """Count an evaluation, and tell whether it must have sums: a sample is ``wanted`` now, or the next is expected."""
    looks[SINCE] += int(not wanted)
    looks[WITH_SUMS] = wanted or looks[SINCE] == looks[BETWEEN]
    return looks[WITH_SUMS] != 0


@jit
def note_look(looks):
    """Begin to count the evaluations after a sample."""
    looks[BETWEEN], looks[SINCE] = looks[SINCE], 0
