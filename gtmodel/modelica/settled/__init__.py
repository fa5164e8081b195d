"""Passes over a flattened class: events as the language has them, and static optimizations."""
