"""Kind "trajectory_table"."""
