"""Clocks brought together, and delays: two recordings of one signal, sampled by different clocks or late."""
