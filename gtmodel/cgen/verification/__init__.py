"""Comparison of generated C with Python."""
