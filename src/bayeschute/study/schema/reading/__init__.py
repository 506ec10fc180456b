"""How tables of a file are read: strictly, all faults at once, with a word on what was meant."""
