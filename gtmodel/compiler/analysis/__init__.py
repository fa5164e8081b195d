"""What expressions tell before they are computed: bounds, sizes, pace, kinks, constant and common parts."""
