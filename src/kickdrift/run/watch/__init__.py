"""Watchers of a run, and its search for collisions, close approaches, escapes and crossings."""
