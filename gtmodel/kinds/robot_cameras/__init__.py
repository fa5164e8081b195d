"""Kind "robot_cameras"."""
