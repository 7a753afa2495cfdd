"""Slots of a loop's cursor, after EVALUATIONS."""

# Steps done in this call, next stage, whether `work` holds the derivative at y (with groups of forces a bit for each
# group), rejected steps.
STEP, STAGE, FRESH, REJECTED = 1, 2, 3, 4
