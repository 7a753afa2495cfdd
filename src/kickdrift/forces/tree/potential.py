"""The potential of a tree at its own particles, outside a run."""

from kickdrift.forces.tree.kernel import sum_all
from kickdrift.jit.compile import driver
from kickdrift.jit.handle import handle


@driver
def tree_potential(force, x):
    """Compute the potential at the positions x (3, n), in the tree's order. Return whether x is finite."""
    return sum_all(handle(force), True, x)
