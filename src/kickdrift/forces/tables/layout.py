"""Where compiled code finds the rows of a table."""

SHIFT = 52 - 10  # bits of a float64 that do not count for its cell: 1024 cells between powers of two
MARK = 2.0**52  # plus a whole number: the float's low bits are that number
PAIR_ROW = 4  # float64 in a row of pairs
LISTED_ROW = 8  # of bonds, angles and dihedrals; six are used
EDGE = 1e-6  # of a cell, for places that rounding puts beyond a table's ends
