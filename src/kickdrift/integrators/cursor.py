"""Slots of a loop's cursor, after EVALUATIONS."""

# Steps done in this call, next stage, whether `work` holds the derivative at y, rejected steps.
STEP, STAGE, FRESH, REJECTED = 1, 2, 3, 4
