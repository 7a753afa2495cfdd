"""`kickdrift.solve`: the solution of an ordinary differential equation, in SciPy's form.

Imports the integration under way and the report. Nothing else of this layer uses it.
"""
