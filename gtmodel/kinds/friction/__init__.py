"""Kind "friction"."""
