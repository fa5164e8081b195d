"""Kinematics that a model's equations alone do not answer.

maps              velocity and acceleration maps of any position causality
singularity       how far a pose is from a singular one, as lengths and angles
"""

from . import singularity
from .maps import MotionMaps

__all__ = ["MotionMaps", "singularity"]
