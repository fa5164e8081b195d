"""The compiler: turns a model into a function for any causality. It does not depend on robots."""
