"""Kind "dynamic_stiffness"."""
