"""Pictures of cameras: residuals over the picture, ellipsoids of positions, places compared."""
