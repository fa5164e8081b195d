"""Files of all kinds as streams: tables with named columns, read in blocks."""
