"""All assembly modes of a platform on six legs, with a certificate that none is missing.

Modes
    assembly_modes        of one platform: joints A, B (6, 3), lengths L (6,) -> AssemblyModes
    assembly_modes_batch  of many platforms or poses at once
    AssemblyModes         real modes R, T, all complex ones, status, message, certificate
    Certificate           found, real, distinct, residual, nearest other mode, retries

Start systems
    start_systems         the stored random complex platforms with their 40 solutions each
    StartSystem           one of them; ``make_start_systems``, run as a module, makes them anew
"""

from .certificate import Certificate
from .result import AssemblyModes
from .solve import assembly_modes, assembly_modes_batch
from .start_system import StartSystem, start_systems

__all__ = [
    "AssemblyModes",
    "Certificate",
    "StartSystem",
    "assembly_modes",
    "assembly_modes_batch",
    "start_systems",
]
