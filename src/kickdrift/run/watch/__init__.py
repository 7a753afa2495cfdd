"""The search of a run's steps for collisions, close approaches, escapes and crossings, and what these do."""
