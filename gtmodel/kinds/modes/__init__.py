"""Kind "modes"."""
