"""Inspection of a log before it is used: columns, guessed units with reasons, rates, gaps, clocks, ranges."""
