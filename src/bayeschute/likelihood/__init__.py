"""Priors, noise, disturbances and the linear-Gaussian algebra along a flight."""
