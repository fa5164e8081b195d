"""Solutions of a block in closed form: linear equations, quadrics, one angle."""
