"""Heat baths as flows of splitting words.

Imports `stepping`. Words and barostats use them.
"""
