"""What a run watches for: collisions, close approaches, escapes and crossings."""
