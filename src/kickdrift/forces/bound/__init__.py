"""The forces of one System, bound: the table that step loops take, one evaluation of all, their lists and memory.

Imports the kernels of all families. Integrators, looks and engines use it.
"""
