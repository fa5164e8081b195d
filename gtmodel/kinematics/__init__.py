"""Kinematics that a model's equations alone do not answer.

assembly_modes    every pose in which a platform on six legs of given lengths can be assembled
"""

from . import assembly_modes

__all__ = ["assembly_modes"]
