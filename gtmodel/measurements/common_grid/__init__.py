"""Recordings with clocks of their own brought on one clock and one even grid."""
