"""Calibration of a study, and what a run may claim by it."""
