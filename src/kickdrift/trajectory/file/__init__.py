"""HDF5 files, whatever they hold: safe opening, locking, writes that survive a kill, packing.

Imports nothing of the layer. Writers and readers use it.
"""
