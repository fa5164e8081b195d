"""Closed-form functions on many rows: one operation at a time on a block of rows that fits into the cache."""
