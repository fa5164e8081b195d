"""From an Optimization to a pointwise problem: form, limits, cost, sizes."""
