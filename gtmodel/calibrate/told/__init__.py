"""What a calibration tells: findings, intervals, the verdict, the table, pictures and files."""
