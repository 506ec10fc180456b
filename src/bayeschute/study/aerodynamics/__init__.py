"""Aerodynamic curves of a fit, what others know of them, and what its latent forces follow."""
