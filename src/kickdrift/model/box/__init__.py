"""The simulation box: its edges, its images, and its form in compiled code.

Imports checks alone. States, lists and forces use `box`; kernels use `cell`.
"""
