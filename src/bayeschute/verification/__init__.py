"""Verification: check cases, simulated flights against closed-form solutions."""
