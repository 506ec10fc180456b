"""Calibration: coverage of intervals and bands over replicates, and simulation-based calibration."""
