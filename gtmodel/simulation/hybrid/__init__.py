"""Simulation of models with events and sampled blocks: pieces of ordinary simulation between the instants."""
