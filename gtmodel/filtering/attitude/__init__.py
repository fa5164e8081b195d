"""Attitude of a body that a gyro carries between references of orientation: calibration, gaps, both judged."""
