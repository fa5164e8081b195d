"""Pictures: one module per subject. Every function takes data, imports no study, and returns a matplotlib Figure."""
