"""Equation error by least squares with colored residuals and orthogonal functions."""
