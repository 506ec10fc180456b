"""What every room may use: errors, units, vectors, processors."""
