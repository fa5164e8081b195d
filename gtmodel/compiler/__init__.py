"""The compiler: from a model to one function for any causality. Knows no robot."""
