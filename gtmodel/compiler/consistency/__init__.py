"""Points that satisfy the equations: sampled, the home pose, completed guesses, initial values."""
