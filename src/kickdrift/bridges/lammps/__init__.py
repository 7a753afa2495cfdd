"""Systems from inputs of LAMMPS, which LAMMPS itself reads in a process of its own."""
