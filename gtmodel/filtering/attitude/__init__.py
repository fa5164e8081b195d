"""Attitude of a body that a gyro carries between references of orientation: calibration, gaps, and a test of both."""
