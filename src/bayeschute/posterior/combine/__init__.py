"""Posteriors of several flights, bodies or structures together."""
