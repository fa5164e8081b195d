"""Options of a friction study: poses, runs at constant velocity, synthetic runs; and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from ...results import Quantity, Row, Study, listed
from ...results.options import Options, Unit, Within
from ...results.study import to_inherit
from ...results.suspicion import EveryAlarm

# alarms about how runs and their columns were read; each can be accepted
FrictionAlarm = Literal["copied_runs", "exchanged_columns", "driving_friction", "negative_mass", EveryAlarm]
CUTOFF_HZ = 10.0  # of the low pass that detects rows at constant velocity; means are of unfiltered rows
ACCELERATION = 0.2  # m/s2, largest acceleration at constant velocity
SHORTEST = 0.2  # s


@dataclass(frozen=True)
class HeldPose(Options):
    """Position of the tool centre point in the cross-section while the carts ran.

    >>> pose = gt.identify.HeldPose(holding=[-177.0, -15.0, 191.0], holding_mass=22.4)
    >>> gt.identify.gravity_pattern(gt.robots.gantry_tau("l1_tape"), [pose]).round(2)  # N/kg
    array([[-7.9 , -0.67,  8.53]])
    """

    name: Annotated[str, "one word for plots"] = ""
    tcp: Annotated[
        list[float] | None, Unit("m"),
        "a point on the way; with guideways along x the coordinate along them does not matter",
    ] = None  # fmt: skip
    holding: Annotated[
        list[float] | None, Unit("N"), "printed gravity force of each cart for holding_mass, instead of tcp"
    ] = None
    holding_mass: Annotated[float | None, Unit("kg"), Within(above=0.0), "mass that these forces hold"] = None


@dataclass(frozen=True)
class ConstantVelocity(Options):
    """Which parts of a log count as runs at constant velocity.

    >>> gt.identify.ConstantVelocity(slowest=-0.1)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: slowest: must be at least 0; found -0.1
    """

    cutoff: Annotated[
        float, Unit("Hz"), Within(above=0.0),
        "cut-off of the low pass that detects rows at constant velocity; means use unfiltered rows",
    ] = CUTOFF_HZ  # fmt: skip
    slowest: Annotated[float, Unit("m/s"), Within(least=0.0), "slower runs are dropped"] = 0.0
    steady_acceleration: Annotated[
        float, Unit("m/s2"), Within(above=0.0),
        "rows count as constant velocity while all accelerations are smaller",
    ] = ACCELERATION  # fmt: skip
    shortest_run: Annotated[float, Unit("s"), Within(above=0.0), "shorter runs are dropped"] = SHORTEST


@dataclass(frozen=True)
class FrictionCoefficients(Options):
    """Friction by cart, and the mass held: the force is fc+ + fv+ v forwards and -fc- + fv- v backwards, with v < 0.

    >>> gt.identify.FrictionCoefficients([189.0], [145.0], [205.0], [158.0], mass=0.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: mass: must be more than 0; found 0
    """

    coulomb_plus: Annotated[list[float], Unit("N"), "Coulomb friction forwards"]
    coulomb_minus: Annotated[list[float], Unit("N"), "Coulomb friction backwards, positive"]
    viscous_plus: Annotated[list[float], Unit("kg/s"), "viscous friction forwards"]
    viscous_minus: Annotated[list[float], Unit("kg/s"), "viscous friction backwards"]
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "plate and half the links"]


@dataclass(frozen=True)
class SyntheticRuns(FrictionCoefficients):
    """Synthetic logs of known friction, to check an identification.

    >>> known = gt.identify.SyntheticRuns(
    ...     [150.0] * 3, [140.0] * 3, [190.0] * 3, [180.0] * 3, mass=22.0, velocities=[0.2, 0.5, 1.0], noise=5.0
    ... )
    >>> pose = gt.identify.HeldPose(holding=[-177.0, -15.0, 191.0], holding_mass=22.4)
    >>> s = gt.identify.friction_study(gt.robots.gantry_tau("l1_tape"), known, [pose])
    >>> s.runs, s.synthetic
    (6, 'seed 0, white force noise 5 N, positions in steps of 1e-06 m')
    """

    velocities: Annotated[list[float], Unit("m/s"), Within(above=0.0), "two or more; each is run back and forth"]
    moved_mass: Annotated[
        float, Unit("kg"), Within(least=0.0), "inertia of each motor in the ramps between runs"
    ] = 30.0  # fmt: skip
    noise: Annotated[float, Unit("N"), Within(least=0.0), "white, standard deviation"] = 5.0
    quantisation: Annotated[float, Unit("m"), Within(least=0.0), "step of the positions"] = 1e-6
    seed: Annotated[int, Within(least=0), "of the noise"] = 0


Array = np.ndarray


LABELS = {
    "coulomb_plus": "Coulomb friction forwards",
    "coulomb_minus": "Coulomb friction backwards",
    "viscous_plus": "viscous forwards",
    "viscous_minus": "viscous backwards",
}


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrictionStudy(Study):
    """Friction by actuator and direction of motion, and the mass held; None if stopped before the fit."""

    mass: Annotated[float | None, Quantity("kg", "mass that the cart forces hold: plate and half of the links")] = None
    mass_interval: Annotated[
        Sequence[float] | None, Quantity("kg", "95 % interval; if the runs do not determine the mass, of the choice")
    ] = None
    mass_by_norm: Annotated[
        Mapping[str, Any] | None,
        Quantity("kg", "mass of least asymmetry by norm: two, one (interval), maximum"),
    ] = None
    coulomb_plus: Annotated[Array | None, Quantity("N", "Coulomb friction forwards, by cart")] = None
    coulomb_minus: Annotated[Array | None, Quantity("N", "Coulomb friction backwards, by cart")] = None
    viscous_plus: Annotated[Array | None, Quantity("kg/s", "viscous friction forwards, by cart")] = None
    viscous_minus: Annotated[Array | None, Quantity("kg/s", "viscous friction backwards, by cart")] = None
    intervals: Annotated[
        Mapping[str, Sequence[float]] | None, Quantity("", "95 % intervals by name: m, coulomb_plus[0], ...")
    ] = None
    middle: Annotated[
        Array | None,
        Quantity("N", "level between the two directions, by pose and cart: gravity and asymmetric friction together"),
    ] = None
    pattern: Annotated[Array | None, Quantity("N/kg", "force of each cart that holds one kilogram, by pose")] = None
    residual: Annotated[Array | None, Quantity("N", "rms residual of the fitted lines, by cart")] = None
    runs: Annotated[int | None, Quantity("", "number of runs at constant velocity")] = None
    synthetic: Annotated[
        str | None, Quantity("", "seed and noise of synthetic logs; null for measured ones")
    ] = None  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        """Rows of the table."""
        if self.mass_interval is None or self.mass_by_norm is None or self.residual is None:
            return []
        (low, high), (first, last) = self.mass_interval, self.mass_by_norm["one"]
        return [
            Row("mass held", self.mass, "kg"),
            Row("95 % interval", f"{low:.4g} .. {high:.4g}", "kg"),
            Row("1-norm: minimal from", f"{first:.4g} to {last:.4g}", "kg"),
            Row("maximum norm", self.mass_by_norm["maximum"], "kg"),
            *self._coefficients(),
            Row("residual of the lines", listed(self.residual), "N"),
            Row("runs at constant velocity", self.runs),
            *([Row("SYNTHETIC", self.synthetic)] if self.synthetic else []),
        ]

    def _coefficients(self) -> list[Row]:
        units = {name: q.unit for name, q in self.quantities().items()}
        return [Row(label, listed(getattr(self, name)), units[name]) for name, label in LABELS.items()]
