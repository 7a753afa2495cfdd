"""Memory that compiled code reads through handles."""

import numpy as np
import pytest
from numba import njit, types
from numba.extending import intrinsic

from kickdrift.jit.handle import put_array

ARRAYS = {
    "a row": np.zeros(3),
    "three axes": np.zeros((2, 3, 4)),
    "every second": np.zeros((2, 6, 4))[:, ::2],
    "backwards": np.zeros(5, np.int32)[::-1],
    "empty": np.zeros((3, 0), np.float32),
    "columns first": np.zeros((3, 4), bool, order="F"),
}


@intrinsic
def numbers_of(typingctx, array):
    """The structure of an array as numba holds it, as a tuple of whole numbers, from the third on."""
    kept = types.UniTuple(types.intp, 3 + 2 * array.ndim)

    def codegen(context, builder, sig, args):
        found = context.make_array(array)(context, builder, value=args[0])
        data = builder.ptrtoint(found.data, context.get_value_type(types.intp))
        many = [part for whole in (found.shape, found.strides) for part in _parts(builder, whole, array.ndim)]
        return context.make_tuple(builder, kept, [found.nitems, found.itemsize, data, *many])

    return kept(array), codegen


def _parts(builder, whole, count):
    return [builder.extract_value(whole, k) for k in range(count)]


@njit
def compiled(array):
    return numbers_of(array)


@pytest.mark.parametrize("name", ARRAYS)
def test_the_structure_of_an_array_is_numbas(name):
    array = ARRAYS[name]
    memory = np.full(5 + 2 * array.ndim, 7, np.intp)
    put_array(array, memory.ctypes.data)
    assert memory.tolist() == [0, 0, *compiled(array)]
