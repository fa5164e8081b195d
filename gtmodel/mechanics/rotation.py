"""Rotation matrices of the language, as the parts need them."""

from ..geometry.expressions import quaternion_velocity as quaternion_velocity
from ..geometry.quaternions import quaternion_matrix as quaternion_matrix
from ..geometry.rotations import rotation_about as rotation_about
