"""Close pairs inside block steps: their orbits, how others feel them, and when pairs form and break up.

Imports `stepper`, the Kepler motion and the weights of `wisdom_holman`, and `stepping`. `method` uses the stepper.
"""
