"""Pictures: one module per kind of picture. Every function takes results and returns a matplotlib Figure."""
