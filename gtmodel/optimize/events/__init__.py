"""Optimal control of models with events whose order is given: a phase for each piece between them."""
