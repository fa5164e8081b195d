"""Kind "calibration_plan"."""
