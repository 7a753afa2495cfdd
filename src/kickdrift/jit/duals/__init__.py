"""Numbers with derivatives as a compiled type, for single numbers, arrays and lanes.

Imports `lanes`. Forces and methods use it for derivatives of what they compute.
"""
