"""Kinematics that a model's equations alone do not answer.

accuracy          greatest positioning errors from errors of carts and links
assembly_modes    every pose in which a platform on six legs of given lengths can be assembled
section           a plane across the guideways
workspace         which tool centre points are reached, and why not the others
"""

from . import accuracy, assembly_modes, section, workspace

__all__ = ["accuracy", "assembly_modes", "section", "workspace"]
