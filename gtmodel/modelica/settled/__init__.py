"""Passes over a flattened class: events in gtmodel's forms, static optimizations, and units."""
