"""All assembly modes of a platform on six legs, with a certificate that none is missing.

    assembly_modes        of one platform: joints A, B (6, 3), lengths L (6,) -> AssemblyModes
    assembly_modes_batch  of many poses at once
    AssemblyModes         real modes R, T, all complex ones, status, message, certificate
    Certificate           found, real, distinct, residual, nearest other mode, retries

``python -m gtmodel.kinematics.assembly_modes.make_start_systems`` makes the stored start systems anew.
"""

from .certificate import Certificate
from .result import AssemblyModes
from .solve import assembly_modes, assembly_modes_batch

__all__ = ["AssemblyModes", "Certificate", "assembly_modes", "assembly_modes_batch"]
