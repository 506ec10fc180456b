"""Bands, requirements, exceedance and the files of a risk assessment."""
