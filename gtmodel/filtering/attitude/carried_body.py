"""The same gaps by the error-state filter and its smoother: a body that a gyro carries, with a relative error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...geometry.expressions import quaternion_kinematics
from ...lang.declare import input as known, parameter, variable
from ...lang.functions import der, dot, sqrt
from ...lang.model import Model
from ...results.trajectory import Trajectory
from ..belief import InitialState
from ..error_state import ErrorState
from ..filtered import Filtered
from ..process import ProcessModel
from ..readings import Readings
from ..sensors import Sensor
from ..system import System
from .gyro_path import picked
from .reference_noise import ReferenceNoise


class GyroCarriedBody(Model):
    """A body whose rate a gyro gives as a known input, but for an error in proportion to the rate that changes slowly.

    States Q (unit quaternion, body to world, scalar first) and the relative error e of the rate, in the axes of the
    body, an Ornstein-Uhlenbeck process driven by `drift`.

    >>> body = gt.filtering.GyroCarriedBody(persistence=2.0)
    >>> process = gt.filtering.ProcessModel(
    ...     body, noise={"drift": 1e-5}, inputs=["rate"], states=["Q", "e"], quaternions=["Q"]
    ... )
    >>> process.inputs
    ('rate',)
    """

    persistence = parameter(1.0, unit="s", description="of the relative error")
    Q = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], description="body to world, scalar first")
    e = variable(3, unit="1", description="error of the rate over its size, in the axes of the body")
    rate = known(3, unit="rad/s", description="of the gyro, calibrated")
    drift = known(3, unit="1/s")

    def equations(self) -> Any:
        w = self.rate + self.e * sqrt(dot(self.rate, self.rate) + SLOW**2)
        scalar, rates = quaternion_kinematics(self.Q, w)
        yield der(self.Q[0]) == scalar
        yield der(self.Q[1:4]) == rates
        yield der(self.e) == -self.e / self.persistence + self.drift


SLOW = 1e-3  # rad/s: keeps the root of the rate's square smooth at rest
LEAST = 1e-4  # rad, of the readings: the filter divides by it


def attitude_filter(
    time: np.ndarray,
    rate: np.ndarray,
    reference_time: np.ndarray,
    reference: Rotation,
    noise: ReferenceNoise,
    used: np.ndarray,
    ask: Callable[[], None] = lambda: None,
) -> Filtered:
    """The error-state filter over a whole stretch, with the references that are `used` (k,) as readings.

    time (n,), rate (n, 3): of the calibrated gyro, by the reference's clock. Its instants are the samples of the gyro
    and all references; of those that are not used nothing is read. The timing of the references counts as an error of
    the same size about all axes, that of the mean square of the rate. ask: called now and then; may raise.

    >>> from scipy.spatial.transform import Rotation
    >>> time = 0.01 * np.arange(201)
    >>> rate = np.tile([0.0, 0.0, 1.0], (201, 1))
    >>> at = 0.5 * np.arange(5)
    >>> true = Rotation.from_rotvec(np.outer(at, [0.0, 0.0, 1.01]))
    >>> noise = gt.filtering.ReferenceNoise(timing=1e-4, relative=0.02, floor=1e-4, persistence=5.0)
    >>> run = gt.filtering.attitude_filter(time, rate, at, true, noise, np.ones(5, bool))
    >>> run["e"][-1].round(2).tolist()  # the gyro reads one per cent too little
    [0.0, 0.0, 0.01]
    """
    inside = (time > reference_time[0]) & (time < reference_time[-1])
    nodes = np.unique(np.concatenate([time[inside], reference_time]))
    rates = np.column_stack([np.interp(nodes, time, rate[:, k]) for k in range(3)])
    values = np.full((len(nodes), 4), np.nan)
    rows = np.searchsorted(nodes, reference_time)
    values[rows[used]] = picked(reference, used).as_quat(scalar_first=True)
    size = float(np.sqrt(np.mean(np.sum(rates**2, axis=1)) / 3)) * noise.timing
    deviation = max(float(np.hypot(size, noise.floor)), LEAST)
    density = 2 * noise.relative**2 / noise.persistence
    body = GyroCarriedBody(persistence=noise.persistence)
    process = ProcessModel(body, noise={"drift": density}, inputs=["rate"], states=["Q", "e"], quaternions=["Q"])
    system = System(process, [Sensor("reference", "Q", deviation=deviation, kind="quaternion")])
    begin = reference[0].as_quat(scalar_first=True)
    start = InitialState({"Q": begin}, {"Q": deviation, "e": noise.relative}, time=float(nodes[0]))
    inputs = Trajectory(nodes, {"rate": rates}, {"rate": "rad/s"})
    log = {"reference": Readings(nodes, values)}
    return ErrorState(system).run(log, start, inputs=inputs, progress=lambda _: bool(ask()))
