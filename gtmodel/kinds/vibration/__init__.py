"""Kind "vibration"."""
