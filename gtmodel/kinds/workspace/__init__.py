"""Kind "workspace"."""
