"""Campaigns of landings: their file, the draws of the posterior that they take, and their rows as they come."""
