"""Assessment of solutions: discretisation error, re-simulation, refinement, diagnosis of failures."""
