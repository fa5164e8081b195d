"""Kind "resampling"."""
