"""Kind "calibration"."""
