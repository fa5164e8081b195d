"""Scene of the fusion study: bodies with a tracker target and an inertial unit, synthetic readings along a path, and
the filters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...geometry.expressions import quaternion_kinematics, rotated_back
from ...lang.declare import input as known, parameter, variable
from ...lang.expression import vector
from ...lang.functions import cross, der, dot, sqrt
from ...lang.model import Model
from ..belief import InitialState, Readings
from ..discrete_process import DiscreteProcess
from ..manifold import StatePart
from ..paths import BodyMotion, TrackedPath
from ..process import AnyProcess, ProcessModel
from ..sensors import Sensor
from ..synthetic import synthetic_readings
from ..system import System
from .options import FusionFilter, FusionSensors


class TranslatingBody(Model):
    """A body that does not turn, with an inertial unit: its acceleration is driven by white jerk.

    States p, v, a in the world. `specific_force` is the accelerometer's reading, a - gravity in the axes of the unit.

    gravity: acceleration of free fall in the world; zero to leave it out. mount: orientation of the unit in the axes of
    the body, a unit quaternion, scalar first. misalignment: small rotation vector of the unit relative to `mount`, in
    its own axes.

    >>> body = gt.filtering.TranslatingBody(gravity=[0.0, 0.0, 0.0])
    >>> process = gt.filtering.ProcessModel(body, noise={"jerk": 0.1}, states=["p", "v", "a"])
    >>> sensors = [gt.filtering.Sensor("tracker", "p", deviation=6.4e-6)]
    >>> gt.filtering.System(process, sensors).linear
    True
    """

    gravity = parameter([0.0, 0.0, -9.81], unit="m/s2", description="acceleration of free fall in the world")
    mount = parameter([1.0, 0.0, 0.0, 0.0], unit="1", description="axes of the unit in those of the body")
    misalignment = parameter([0.0, 0.0, 0.0], unit="rad", description="of the unit against its mount")
    p = variable(3, unit="m", description="position in the world")
    v = variable(3, unit="m/s")
    a = variable(3, unit="m/s2")
    jerk = known(3, unit="m/s3")
    specific_force = variable(3, unit="m/s2", description="in the axes of the unit")

    def equations(self) -> Any:
        yield der(self.p) == self.v
        yield der(self.v) == self.a
        yield der(self.a) == self.jerk
        yield self.specific_force == _in_unit(self, self.a - self.gravity)


class TurningBody(Model):
    """A body that moves and turns, with an inertial unit: its acceleration is driven by white jerk, its angular
    acceleration by white angular jerk.

    States p, v, a in the world, Q (unit quaternion, body to world, scalar first), w and alpha in the axes of the body.
    `specific_force` and `rate` are the readings of accelerometer and gyro in the axes of the unit. The accelerometer is
    at `arm` in the axes of the body, so it measures a + alpha x arm + w x (w x arm) - gravity: Cvitanic 2021, (29),
    written for the unit. The other parameters are those of `TranslatingBody`.

    >>> body = gt.filtering.TurningBody(arm=[0.18, 0.1, -0.12])
    >>> process = gt.filtering.ProcessModel(
    ...     body, noise={"jerk": 1e2, "angular_jerk": 1e6}, states=["p", "v", "a", "Q", "w", "alpha"], quaternions=["Q"]
    ... )
    >>> sensors = [gt.filtering.Sensor("gyro", "rate", deviation=8.8e-4)]
    >>> system = gt.filtering.System(process, sensors)
    >>> system.space.size, system.space.dimension
    (19, 18)
    """

    gravity = parameter([0.0, 0.0, -9.81], unit="m/s2", description="acceleration of free fall in the world")
    arm = parameter([0.0, 0.0, 0.0], unit="m", description="place of the accelerometer in the axes of the body")
    mount = parameter([1.0, 0.0, 0.0, 0.0], unit="1", description="axes of the unit in those of the body")
    misalignment = parameter([0.0, 0.0, 0.0], unit="rad", description="of the unit against its mount")
    p = variable(3, unit="m", description="position in the world")
    v = variable(3, unit="m/s")
    a = variable(3, unit="m/s2")
    Q = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], description="body to world, scalar first")
    w = variable(3, unit="rad/s", description="in the axes of the body")
    alpha = variable(3, unit="rad/s2", description="in the axes of the body")
    jerk = known(3, unit="m/s3")
    angular_jerk = known(3, unit="rad/s3")
    specific_force = variable(3, unit="m/s2", description="in the axes of the unit")
    rate = variable(3, unit="rad/s", description="in the axes of the unit")

    def equations(self) -> Any:
        q, w = self.Q, self.w
        scalar, rates = quaternion_kinematics(q, w)
        yield der(self.p) == self.v
        yield der(self.v) == self.a
        yield der(self.a) == self.jerk
        yield der(q[0]) == scalar
        yield der(q[1:4]) == rates
        yield der(w) == self.alpha
        yield der(self.alpha) == self.angular_jerk
        at_body = rotated_back(q, self.a - self.gravity)
        at_unit = at_body + cross(self.alpha, self.arm) + cross(w, cross(w, self.arm))
        yield self.specific_force == _in_unit(self, at_unit)
        yield self.rate == _in_unit(self, w)


def _in_unit(body: Any, v: Any) -> Any:
    """A vector of the body in the axes of its inertial unit."""
    e = body.misalignment
    length = sqrt(1 + dot(e, e) / 4)
    small = vector([1 / length, e[0] / 2 / length, e[1] / 2 / length, e[2] / 2 / length])
    return rotated_back(small, rotated_back(body.mount, v))


MOUNT = (0.0, 0.0, 1.0, 0.0)  # of the unit: half a turn about y, Cvitanic 2021, 4.2.2
STATES = ("p", "v", "a", "Q", "w", "alpha")
PRINTED_Q = np.repeat([2.54e-4, 21.2e-4, 98.1e-4], 3)  # Cvitanic 2021, appendix B, per step
# initial standard deviations on the path at full speed: about the accuracy from some milliseconds of readings
START = {"p": 1e-5, "v": 1e-3, "a": 0.1, "Q": 1e-3, "w": 1e-3, "alpha": 1.0}
OUTLYING = 20.0  # standard deviation of an outlier over that of the tracker's noise
FREE_FALL = (0.0, 0.0, -9.81)  # m/s2


@dataclass(frozen=True, eq=False)
class Scene:
    """A motion, its synthetic readings, and the truth by state."""

    path: TrackedPath
    sensors: FusionSensors
    motion: BodyMotion
    log: dict[str, Readings]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states of the process."""
        return STATES if self.path.axes == 5 else STATES[:3]

    @property
    def truth(self) -> dict[str, np.ndarray]:
        """True states at the instants."""
        return {name: getattr(self.motion, name) for name in self.states}

    @property
    def peak(self) -> np.ndarray:
        """Mask of the bends of the path: |angular velocity of the tangent| above a fifth of its maximum."""
        turning = np.linalg.norm(self.motion.a, axis=1)
        return turning > 0.2 * turning.max() if turning.max() > 0 else np.zeros(len(turning), bool)

    @property
    def initial(self) -> InitialState:
        """Initial estimate: the true state, with its uncertainty."""
        truth = self.truth
        return InitialState({n: truth[n][0] for n in self.states}, {n: START[n] for n in self.states})


def process_of(path: TrackedPath, sensors: FusionSensors, design: FusionFilter, *, true: bool = False) -> AnyProcess:
    """Process of the filter; `true`: with the errors of the unit that the filter does not know."""
    gravity = FREE_FALL if sensors.gravity else (0.0, 0.0, 0.0)
    turned = (0.0, 0.0, sensors.misalignment if true else 0.0)
    noise: dict[str, Any] = {"jerk": design.jerk_density}
    if path.axes == 3:
        if design.printed and not true:
            return printed_process(sensors, design)
        body = TranslatingBody(gravity=gravity, mount=MOUNT, misalignment=turned)
        return ProcessModel(body, noise, states=STATES[:3])
    arm = np.add(sensors.arm, (0.0, 0.0, sensors.arm_error if true else 0.0))
    body = TurningBody(gravity=gravity, mount=MOUNT, misalignment=turned, arm=arm)
    noise["angular_jerk"] = design.angular_jerk_density
    return ProcessModel(body, noise, states=STATES, quaternions=["Q"])


def printed_process(sensors: FusionSensors, design: FusionFilter) -> DiscreteProcess:
    """Process of (21) to (23) with the covariance of appendix B; axes of the unit after its mount."""
    dt = sensors.sample_time
    share = 0.5 if design.exact_step else 1.0
    g = np.array(FREE_FALL if sensors.gravity else (0.0, 0.0, 0.0))

    def step(x: Any) -> dict[str, Any]:
        return {"p": x.p + dt * x.v + share * dt * dt * x.a, "v": x.v + dt * x.a, "a": x.a}

    parts = [StatePart(n, size=3, unit=u) for n, u in zip(STATES[:3], ("m", "m/s", "m/s2"), strict=True)]
    outputs = {"specific_force": lambda x: np.array([-1.0, 1.0, -1.0]) * (x.a - g)}  # half a turn about y
    return DiscreteProcess(parts, dt, step, PRINTED_Q, outputs)


def sensors_of(path: TrackedPath, s: FusionSensors, design: FusionFilter | None = None) -> list[Sensor]:
    """Sensors as the filter knows them."""
    tracker = Sensor("tracker", "p", deviation=s.position_noise)
    unit = Sensor("accelerometer", "specific_force", density=s.acceleration_noise, period=s.sample_time)
    sensors = [tracker, unit]
    if path.axes == 5:
        orientation = Sensor("orientation", "Q", kind="quaternion", deviation=s.orientation_noise)
        gyro = Sensor("gyro", "rate", density=s.rate_noise, period=s.sample_time)
        sensors = [tracker, orientation, unit, gyro]
    weighed = None if design is None else design.outliers  # not for the unit: at bends its readings look like outliers
    return [replace(s, outliers=weighed) if s.name in ("tracker", "orientation") else s for s in sensors]


def scene_of(path: TrackedPath, sensors: FusionSensors, seed: int) -> Scene:
    """Readings along a path, with the biases and errors that the filter does not know."""
    steps = int(np.floor(path.duration / sensors.sample_time + 1e-9))
    motion = path.motion(sensors.sample_time * np.arange(steps + 1))
    true = System(process_of(path, sensors, FusionFilter(), true=True), sensors_of(path, sensors))
    names = STATES if path.axes == 5 else STATES[:3]
    states = np.concatenate([getattr(motion, name) for name in names], axis=1)
    faults = {"accelerometer": sensors.acceleration_bias} | ({"gyro": sensors.rate_bias} if path.axes == 5 else {})
    log = synthetic_readings(true, motion.time, states, seed=seed, faults=faults)
    if sensors.outlier_share:
        rng = np.random.default_rng([seed, len(true.sensors)])
        hit = rng.random(len(motion.time)) < sensors.outlier_share
        far = OUTLYING * sensors.position_noise * rng.standard_normal((len(motion.time), 3))
        log["tracker"] = Readings(log["tracker"].time, log["tracker"].values + hit[:, None] * far)
    return Scene(path, sensors, motion, log)


def slope_velocity(log: Readings, samples: int = 4) -> np.ndarray:
    """First baseline: slope of a line through the last positions (K, 3), NaN until there are enough."""
    t = np.arange(samples) - (samples - 1) / 2
    dt = float(np.median(np.diff(log.time)))
    weights = t / (t @ t) / dt
    slopes = np.full(log.values.shape, np.nan)
    K = len(log.values)
    slopes[samples - 1 :] = sum(weights[k] * log.values[k : K - samples + 1 + k] for k in range(samples))
    return slopes


def tracker_system(path: TrackedPath, sensors: FusionSensors, design: FusionFilter) -> System:
    """Second baseline: a Kalman filter on the tracker alone, with white jerk."""
    alone = replace(design, printed=False, jerk_density=(design.tracker_jerk_density,) * 3)
    straight = replace(path, axes=3)
    return System(process_of(straight, sensors, alone), sensors_of(straight, sensors, design)[:1])
