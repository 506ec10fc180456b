"""The air that a flight meets: the standard atmosphere, and wind by altitude."""
