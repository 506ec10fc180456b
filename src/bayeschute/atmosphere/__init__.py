"""Atmosphere: the standard atmosphere, and wind by altitude."""
