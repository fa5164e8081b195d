"""Pictures of loops with delay: limits of the gain, what is uncertain, directions, maps."""
