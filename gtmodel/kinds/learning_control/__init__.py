"""Kind "learning_control"."""
