"""Recordings with several clocks on one clock and one even grid."""
