"""Kind "milling"."""
