"""A study file, and everything that is made of it."""
