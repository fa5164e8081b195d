"""Functional mock-up units (FMI 3.0 and 2.0): the models inside other simulators and test benches.

export        a causal function, a step function or a model as an archive -> Fmu
check         compared with Python, read and run by what is installed -> UnitReport
study         several functions into a folder, checked before they are written -> FmuStudy

The other way, by FMPy (extra `fmi`): a unit of anybody as a plant.
RunningUnit   one instance in co-simulation, variables by name; UnitStopped where it has no answer
FmuPlant      behind a simulated controller of gt.loop; PlantUnit declares one for gt.loop.study and files
FmuExperiment what gt.control.learning.study learns on
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .checking import UnitReport as UnitReport, check as check
    from .export import Fmu as Fmu, export as export
    from .plant import FmuExperiment as FmuExperiment, FmuPlant as FmuPlant
    from .plant_unit import PlantUnit as PlantUnit
    from .running import RunningUnit as RunningUnit, UnitStopped as UnitStopped
    from .unit_study import FmuStudy as FmuStudy, study as study

public(__name__)
