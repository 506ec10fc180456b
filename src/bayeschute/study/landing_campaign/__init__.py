"""Campaigns of landings: their file, the posterior draws that they use, and their rows."""
