"""Measured poses: how they stand in a file, read, split in fitted and held-out ones, looked at before a fit.

Measured, MeasuredSignal, FrameStart, Sag   columns of a file and what lies between device and robot
read_poses        the poses of a CSV file
Poses             poses with what is known of their file
CartPoints, read_cart_points   guideways through measured points of the carts
"""

from .cart_points import CartPoints, read_cart_points
from .options import FrameStart, Measured, MeasuredSignal, Sag
from .poses import Poses
from .reading_file import read_poses

__all__ = [
    "CartPoints", "FrameStart", "Measured", "MeasuredSignal", "Poses", "Sag", "read_cart_points", "read_poses",
]  # fmt: skip
