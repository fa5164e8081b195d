"""Simulation of models with events and sampled blocks: ordinary simulation between the instants of events."""
