"""Studies: the files that describe one, and everything that is computed from them."""
