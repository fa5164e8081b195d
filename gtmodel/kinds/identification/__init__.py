"""Kind "identification"."""
