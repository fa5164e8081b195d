"""Kind "simulation"."""
