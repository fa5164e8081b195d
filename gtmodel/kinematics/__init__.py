"""Kinematics that a model's equations alone do not answer.

assembly_modes    every pose in which a platform on six legs of given lengths can be assembled
maps              velocity and acceleration maps of any position causality
singularity       how far a pose is from a singular one, as lengths and angles
"""

from . import assembly_modes, singularity
from .maps import MotionMaps

__all__ = ["MotionMaps", "assembly_modes", "singularity"]
