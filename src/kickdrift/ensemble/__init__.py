"""Ensembles: a system run many times with what varies, on the cores of this machine or on a Dask cluster."""

from kickdrift.ensemble.ensemble import Ensemble

__all__ = ["Ensemble"]
