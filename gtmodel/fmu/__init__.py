"""Functional mock-up units (FMI 3.0 and 2.0): the models inside other simulators and test benches.

export        a causal function, a step function or a model as an archive -> Fmu
check         compared with Python, read and run by what is installed -> UnitReport
study         several functions into a folder, checked before they are written -> FmuStudy
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .checking import UnitReport as UnitReport, check as check
    from .export import Fmu as Fmu, export as export
    from .unit_study import FmuStudy as FmuStudy, study as study

public(__name__)
