"""Kind "stereo"."""
