"""Expressions as numbered operations: written once each, differentiated by elimination, run on many points at once."""
