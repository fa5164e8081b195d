"""Simulation of any model: consistent start, CVODES or IDAS on the reduced system, monitored choice of states.

simulate returns a Simulation; simulation_study returns a SimulationStudy with checks, table and pictures.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .linearize import Mode as Mode, linearize as linearize, natural_modes as natural_modes
    from .options import (
        MOST_ROWS as MOST_ROWS,
        MOST_STEPS as MOST_STEPS,
        NotSimulated as NotSimulated,
        Simulation as Simulation,
        SimulationStudy as SimulationStudy,
        Switch as Switch,
    )
    from .prepare import explain_simulation as explain_simulation
    from .run import simulate as simulate
    from .study import simulation_study as simulation_study

public(__name__)
