"""Step functions: what is computed once in a cycle from inputs and from what is remembered, in C and in Python."""
