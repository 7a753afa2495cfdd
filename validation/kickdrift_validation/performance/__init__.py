"""Speed beside other programs, earlier versions and the peaks of the machine."""
