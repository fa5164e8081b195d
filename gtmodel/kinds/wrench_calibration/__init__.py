"""Kind "wrench_calibration"."""
