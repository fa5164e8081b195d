"""What a calibration reports: findings, intervals, the verdict, the table, pictures and files."""
