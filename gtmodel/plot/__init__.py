"""Pictures: one module per subject. Every function takes results and returns a matplotlib Figure."""
