"""Kind "axis_trajectory"."""
