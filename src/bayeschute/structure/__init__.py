"""Structure selection: candidate terms, the search over them, and how sure its result is."""
