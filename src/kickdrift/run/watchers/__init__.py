"""Watchers of a run: its file, its stream to IMD, and its check of stability.

Imports the integration under way. The Simulation lists them; `run/watcher.py` has their class.
"""
