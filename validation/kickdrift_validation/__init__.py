"""The comparisons of kickdrift with programs and data that others made: claims, each with a bound and a verdict.

``kickdrift validate`` runs the scripts that registry.py lists; ``python -m kickdrift_validation.NAME`` runs one, with
``--long`` for all its claims and ``--figures FOLDER`` for its figures.
"""
