"""Functional mock-up units (FMI 3.0 and 2.0): models for other simulators and test benches.

export        write a causal function, a step function or a model as an archive -> Fmu
check         compare a unit with Python, and read and run it with the installed tools -> UnitReport
study         export several functions into a folder; units are checked before they are written -> FmuStudy

The other direction, with FMPy (extra `fmi`): any FMU as a plant.
RunningUnit   one instance in co-simulation, variables by name; raises UnitStopped if it fails
FmuPlant      the plant of a simulated controller in gt.loop; PlantUnit declares one for gt.loop.study and files
FmuExperiment the plant that gt.control.learning.study learns on
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
