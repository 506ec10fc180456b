"""Structure selection: candidate terms, search, stability of the selection, and simulation studies."""
