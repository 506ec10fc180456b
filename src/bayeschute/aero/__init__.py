"""Aerodynamics: terms of canopies, airflow, the capsule, and published sets."""
