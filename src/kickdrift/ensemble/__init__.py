"""Ensembles: one system run many times with varied values, on the cores of this machine or on a Dask cluster."""

from kickdrift.ensemble.ensemble import Ensemble

__all__ = ["Ensemble"]
