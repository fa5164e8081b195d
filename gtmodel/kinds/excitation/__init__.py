"""Kind "excitation"."""
