"""Alignment of clocks, and delays between signals of one motion."""
