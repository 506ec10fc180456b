"""Calibration evidence of a study: stored coverage, misspecification scenarios, recalibration and label."""
