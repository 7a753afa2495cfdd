"""What a run sees of itself: energies, momenta and their like, looked at in compiled code or in Python."""
