"""Closed-form functions on columns of rows: one operation at a time on a block that stays in the cache."""
