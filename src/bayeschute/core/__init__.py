"""Shared basics: errors, units, vectors, files, random streams, numerical settings."""
