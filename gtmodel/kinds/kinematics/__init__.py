"""Kind "kinematics"."""
