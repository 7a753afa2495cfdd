"""The comparisons of kickdrift with programs and data that others made: claims, each with a bound and a verdict.

``kickdrift validate`` runs the scripts that registry.py lists; ``python -m kickdrift_validation.nist_lj`` runs one.
"""
