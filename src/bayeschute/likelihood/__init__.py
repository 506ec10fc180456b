"""Likelihood: priors, noise models, latent disturbances, and Kalman filters along a flight."""
