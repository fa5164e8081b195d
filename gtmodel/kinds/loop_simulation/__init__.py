"""Kind "loop_simulation"."""
