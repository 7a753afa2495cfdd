"""SIMD as a type: vectors of eight numbers that numba compiles, their operators and functions, and vectors of three.

Imports the compiler. Kernels everywhere use its functions.
"""
