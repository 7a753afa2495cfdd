"""Systems of other programs, made of ours and the other way round; one module for each program."""
