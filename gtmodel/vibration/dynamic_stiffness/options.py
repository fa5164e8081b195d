"""What a study of dynamic stiffness is asked for, and what synthetic experiments consist of."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...results.options import Long, Options, Unit, Within

NEW_POSES = 200  # of synthetic fields, where their truth is compared


@dataclass(frozen=True)
class ModalFitting(Options):
    """How modes are fitted to a frequency response."""

    search: Annotated[list[float], Unit("Hz"), Long(2), "where the most compliant mode is looked for"] = field(
        default_factory=lambda: [3.0, 200.0]
    )
    band: Annotated[
        list[float] | None, Unit("Hz"), Long(2), "lines fitted; 0.7 to 1.3 times the peak if left out"
    ] = None  # fmt: skip
    modes: Annotated[int | None, Within(above=0), "how many; as many as the data ask for if left out"] = None
    most: Annotated[int, Within(least=1, most=5), "modes that are tried at most"] = 3
    relative_noise: Annotated[
        float | None, Within(above=0.0), "of a receptance; without it hits tell their own, or the residuals do"
    ] = None
    estimator: Annotated[Literal["H1", "H2"], "H1 for noise on the response, H2 on the force"] = "H1"
    force_window: Annotated[
        float | None, Unit("s"), Within(above=0.0), "the force is set to zero so long after a hit"
    ] = None  # fmt: skip
    decay: Annotated[
        float, Unit("1/s"), Within(least=0.0), "exponential window on records that do not die away"
    ] = 0.0  # fmt: skip


@dataclass(frozen=True)
class Process(Options):
    """The Gaussian processes of log m, log c and log k over the pose."""

    covariance: Annotated[
        Literal["squared_exponential", "matern_5_2"], "smooth, or with two derivatives"
    ] = "squared_exponential"  # fmt: skip
    scale: Annotated[list[float], Unit("m"), Within(above=0.0), Long(3), "typical lengths of x, y, z"] = field(
        default_factory=lambda: [0.5] * 3
    )
    angle_scale: Annotated[
        float, Unit("rad", written="deg", key="scale_deg"), Within(above=0.0), "typical change of A"
    ] = math.pi / 3  # fmt: skip
    periodic: Annotated[bool, "whether A has a period of 360 degrees"] = True
    shared: Annotated[bool, "whether m, c and k of a direction share their lengths"] = True
    starts: Annotated[int, Within(above=0), "of the search for hyperparameters"] = 4
    seed: Annotated[int, "of these starts and of what is held out"] = 0


@dataclass(frozen=True)
class FrequencyMap(Options):
    """The picture of the lowest frequency over two coordinates of the pose."""

    over: Annotated[list[Literal["x", "y", "z", "A"]], Long(2), "abscissa and ordinate"] = field(
        default_factory=lambda: ["y", "A"]
    )
    at: Annotated[
        list[float] | None, Unit("m"), Long(3), "the other coordinates; the middle of the poses if left out"
    ] = None  # fmt: skip
    at_angle: Annotated[float | None, Unit("rad", written="deg", key="at_deg"), "A, likewise"] = None
    points: Annotated[int, Within(least=5, most=201), "along each side"] = 41


@dataclass(frozen=True)
class SyntheticArm(Options):
    """Synthetic experiments on a smooth field near printed oscillators."""

    seed: Annotated[int, "of field, poses and noise"]
    lengths: Annotated[
        list[float], Within(above=0.0), Long(4),
        "over which it changes in x, y, z and A, in units of the process's scales; ours",
    ] = field(default_factory=lambda: [2.0, 0.8, 2.0, 0.8])  # fmt: skip
    poses: Annotated[int, Within(least=8, most=1000), "Latin hypercube in the box"] = 60
    box: Annotated[list[list[float]], Unit("m"), Long(2), "of x, y, z"] = field(
        default_factory=lambda: [[-0.3, 0.9], [-3.1, -2.1], [0.2, 0.4]]
    )
    box_angle: Annotated[list[float], Unit("rad", written="deg", key="box_deg"), Long(2), "of A"] = field(
        default_factory=lambda: [0.0, math.radians(120.0)]
    )
    records: Annotated[Literal["hits", "receptance"], "what is measured"] = "hits"
    hits: Annotated[int, Within(least=2), "of each experiment"] = 5
    noise: Annotated[
        float, Unit("m/s2"), Within(above=0.0), "of the acceleration in records of hits"
    ] = 0.05  # fmt: skip
    relative_noise: Annotated[float, Within(above=0.0), "of receptances"] = 0.05
    sample_rate: Annotated[float, Unit("Hz"), Within(above=0.0), "of records of hits"] = 1024.0
    duration: Annotated[
        float, Unit("s"), Within(above=0.0), "of each record; of receptances its inverse is the step"
    ] = 4.0  # fmt: skip
