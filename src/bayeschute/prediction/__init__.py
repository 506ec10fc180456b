"""Bands, requirements, landings and the files of a risk assessment."""
