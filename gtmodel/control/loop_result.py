"""What the simulation of a sampled loop answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ..results import Quantity, Study, Trajectory


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LoopSimulationStudy(Study):
    """A motion under a law at samples. trajectory: reference, position and forces on the reference's rows.

    law_samples: what the law read and computed at each sample.
    """

    law_samples: Trajectory | None = None
    period: Annotated[float, Quantity("s", "between two samples", "period", shown="ms", written="ms")]
    delay: Annotated[float, Quantity("s", "until a sample's forces act", "delay", shown="ms", written="ms")]
    samples: Annotated[int, Quantity("", "evaluations of the law", "samples")] = 0
    end_time: Annotated[float, Quantity("s", "time reached", "end time")] = 0.0
    rms_error: Annotated[
        Sequence[float] | np.ndarray,
        Quantity("m", "of each actuator, reference less position, root mean square", "rms error", "mm", "", "mm"),
    ] = ()
    largest_error: Annotated[
        Sequence[float] | np.ndarray, Quantity("m", "of each actuator", "largest error", "mm", "", "mm")
    ] = ()
    last_error: Annotated[
        Sequence[float] | np.ndarray, Quantity("m", "of each actuator, at the end", "error at the end", "mm", "", "mm")
    ] = ()
    largest_force: Annotated[Sequence[float] | np.ndarray, Quantity("N", "of each actuator", "largest force")] = ()
