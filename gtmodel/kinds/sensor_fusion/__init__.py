"""Kind "sensor_fusion"."""
