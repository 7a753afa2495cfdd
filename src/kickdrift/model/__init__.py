"""Model of a simulation: units, boxes, states, Systems, Problems and events. Knows no force, method or run."""
