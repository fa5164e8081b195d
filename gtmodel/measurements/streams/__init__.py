"""Files of all supported formats as streams: tables with named columns, read in blocks."""
