"""Kind "compliance"."""
