"""Systems from OpenMM's objects and files of force fields, and the way back."""
