"""Kind "trajectory"."""
