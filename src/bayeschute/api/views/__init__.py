"""Results with a table and a plot of their own: curves, plausibility of records, rank tests."""
