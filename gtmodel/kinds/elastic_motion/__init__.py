"""Kind "elastic_motion"."""
