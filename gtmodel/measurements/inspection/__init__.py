"""What a log holds, before it is used: columns, units guessed and why, rates, gaps, clocks, ranges."""
