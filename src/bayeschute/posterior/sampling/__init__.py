"""Samplers of any log density in standard coordinates, and checks of their draws."""
