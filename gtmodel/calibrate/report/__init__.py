"""Report of a calibration: findings, intervals, verdict, table, pictures and files."""
