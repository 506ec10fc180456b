"""Fit of flights: joint mode along the record, marginal mode, and Laplace's approximation about it."""
