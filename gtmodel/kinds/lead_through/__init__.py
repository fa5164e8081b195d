"""Kind "lead_through"."""
