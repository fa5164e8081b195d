"""Analysis of expressions before evaluation: bounds, sizes, step lengths, events."""
