"""Consistent points: sample points, the home pose, completed guesses, initial values."""
