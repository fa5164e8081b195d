"""Tapes: expressions as numbered operations, differentiated by elimination and evaluated at many points at once."""
