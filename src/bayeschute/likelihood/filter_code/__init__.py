"""The filter's passes over a record as machine code, generated for the sizes of a flight."""
