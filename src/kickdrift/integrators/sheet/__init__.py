"""The symplectic epicycle integrator of shearing sheets.

Imports `stepping`.
"""
