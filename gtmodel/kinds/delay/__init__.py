"""Kind "delay"."""
