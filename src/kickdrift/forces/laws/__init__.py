"""Forces from one formula: checks and compilation of field laws and body laws, and the common parts of all laws.

Imports `seam`. Shipped forces of these kinds use it; users meet it as `kd.field_law` and `kd.body_law`.
"""
