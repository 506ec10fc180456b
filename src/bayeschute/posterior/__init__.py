"""Posterior: joint mode, noise parameters, marginal Laplace approximation, and sampling."""
