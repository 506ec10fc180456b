"""Frequency and damping of a swing from raw gyro and accelerometer."""
