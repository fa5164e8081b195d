"""Kind "delayed_feedback"."""
