"""Kinematics that the equations alone do not give: all assembly modes of a platform on six legs."""

from .assembly_modes import AssemblyModes, Certificate, assembly_modes, assembly_modes_batch

__all__ = ["AssemblyModes", "Certificate", "assembly_modes", "assembly_modes_batch"]
