"""Equation error by least squares with colored residuals and orthogonal functions."""

from bayeschute.core import threads as threads  # sums of matrix products are rounded alike on any number of cores
