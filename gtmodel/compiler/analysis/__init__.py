"""What expressions show before they are computed: bounds, sizes, pace, nonsmooth points, constant and common parts."""
