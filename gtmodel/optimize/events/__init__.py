"""Optimal control of models with events in a prescribed order: one phase between each pair of events."""
