"""What a solution is worth: discretisation, pulses, overshoot, re-simulation, refinement, diagnosis."""
