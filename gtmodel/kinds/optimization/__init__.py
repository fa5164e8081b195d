"""Kind "optimization"."""
