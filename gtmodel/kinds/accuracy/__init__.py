"""Kind "accuracy"."""
