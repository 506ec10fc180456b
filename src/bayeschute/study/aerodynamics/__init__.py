"""Aerodynamic curves of a fit, external knowledge of them, and terms proposed from the latent forces."""
