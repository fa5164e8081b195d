"""Options of the lead-through studies other than law, contact and sensors, and their results."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np

from ..._lazy import hint
from ...measurements.drift import DriftKind
from ...results import ArgumentError, Quantity, Study
from ...results.options import Options, Unit, Within
from ...results.suspicion import EveryAlarm
from .gains import ZEROS, Three
from .scenes import SyntheticSensor

if TYPE_CHECKING:
    from ..delayed import CorrectedPlant
    from .judgement import PassivityBook
    from .tool_run import ToolRun
else:
    CorrectedPlant = hint("gtmodel.control.delayed", "CorrectedPlant")
    PassivityBook = hint("gtmodel.control.lead_through", "PassivityBook")
    ToolRun = hint("gtmodel.control.lead_through", "ToolRun")

# alarms of the tests of readings at rest; each can be accepted
WrenchAlarm = Literal[
    "force_drift", "force_coloured", "force_temperature", "force_session", "force_largest_residual", "force_held_out",
    "force_frame", "force_axes", "force_over_noise", "force_unexplained_share", "moment_drift", "moment_coloured",
    "moment_temperature", "moment_session", "moment_largest_residual", "moment_held_out", "moment_frame", "moment_axes",
    "moment_over_noise", "moment_unit", EveryAlarm,
]  # fmt: skip
# drifts of the bias that can be estimated
Drift = DriftKind
Between = tuple[float, float]
HANDS_BY = ("mass", "damping", "stiffness")


@dataclass(frozen=True)
class StiffnessRange(Options):
    """Range of contact stiffnesses; the gain of the force control follows from the stiffest.

    >>> gt.control.lead_through.StiffnessRange(500.0, 5000.0).share
    0.4
    """

    softest: Annotated[float, Unit("N/m"), Within(above=0.0), "softest contact"]
    stiffest: Annotated[float, Unit("N/m"), Within(above=0.0), "stiffest contact"]
    share: Annotated[float, Within(above=0.0, below=1.0), "of the gain limit at the stiffest contact"] = 0.4

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.softest > self.stiffest:
            raise ArgumentError(f"must not be above stiffest, {self.stiffest:g} N/m", "softest")


@dataclass(frozen=True)
class GuideSetup(Options):
    """Start of a run, calibration of the sensors before it, and requirements on force and depth.

    >>> gt.control.lead_through.GuideSetup().tolerance
    0.02
    """

    start: Annotated[Three, Unit("m", written="mm"), Within(), "tool centre point at rest"] = (0.0, 0.0, 0.002)
    turn: Annotated[Three, Unit("rad", written="deg"), Within(), "rotation vector of the tool at rest"] = ZEROS
    grip: Annotated[Three, Unit("m", written="mm"), Within(), "position of the hand from the tool centre point"] = ZEROS
    poses: Annotated[int, Within(least=4), "random poses at rest for the calibration of both sensors"] = 24
    readings: Annotated[int, Within(least=1), "averaged in each pose"] = 250
    settled: Annotated[float, Unit("s"), Within(least=0.0), "time in contact before forces are judged"] = 1.0
    tolerance: Annotated[float, Unit("N"), Within(above=0.0), "of the mean force"] = 0.02
    goal: Annotated[float, Within(above=0.0, most=1.0), "share of the hole's depth that the peg must reach"] = 0.9
    seed: Annotated[int, Within(least=0), "of all noise"] = 1


@dataclass(frozen=True)
class ConeComparison(Options):
    """Comparison of the force deviation for several cone widths, with and without a filter of the normal.

    >>> gt.control.lead_through.ConeComparison().speed
    0.1
    """

    cones: Annotated[tuple[float, ...], Unit("rad", written="deg"), Within(least=0.0, most=math.pi / 2),
                     "phi_L of (8.10), increasing"] = (0.0, math.radians(5.0), math.radians(10.0))  # fmt: skip
    tilt: Annotated[float, Unit("rad", written="deg"), Within(above=0.0, below=1.5), "of the second surface"] = (
        math.radians(4.0)
    )
    constant: Annotated[float, Unit("s"), Within(above=0.0), "of the filter"] = 0.2
    noise: Annotated[float, Unit("N"), Within(least=0.0), "of the tool force"] = 0.1
    speed: Annotated[float, Unit("m/s"), Within(above=0.0), "along the surface"] = 0.1
    force_gain: Annotated[float, Unit("m/s/N"), Within(above=0.0), "K of (8.4)"] = 0.01
    stiffness: Annotated[float, Unit("N/m"), Within(above=0.0), "of the contact"] = 5000.0
    duration: Annotated[float, Unit("s"), Within(above=3.0), "of each run"] = 8.0
    seeds: Annotated[int, Within(least=1), "runs for each cone"] = 3


@dataclass(frozen=True)
class ServoChain(Options):
    """Response of the robot to a velocity command along each axis: delay, first-order lag and a mode in series.

    >>> len(gt.control.lead_through.ServoChain(mode_frequency=67.0).plant())  # lag, position, and two of the mode
    4
    """

    lag: Annotated[float, Unit("s"), Within(above=0.0), "time constant of the velocity loop"] = 0.012
    delay: Annotated[float, Unit("s"), Within(least=0.0), "from a command's cycle to its effect"] = 0.008
    mode_frequency: Annotated[float, Unit("Hz"), Within(least=0.0), "natural frequency of the mode; 0: none"] = 0.0
    mode_damping: Annotated[float, Within(above=0.0), "damping ratio of the mode"] = 0.02

    def plant(self) -> CorrectedPlant:
        """Return the plant from the velocity command [m/s] to the position [m]: 1 / (s (lag s + 1)) times the mode."""
        from ..delayed import CorrectedPlant

        if self.mode_frequency == 0:
            return CorrectedPlant(
                np.array([[0.0, 1.0], [0.0, -1 / self.lag]]), np.array([0.0, 1 / self.lag]), np.array([1.0, 0.0])
            )
        w = 2 * np.pi * self.mode_frequency
        a = np.zeros((4, 4))
        a[0, 1] = a[1, 2] = 1.0
        a[2, 1:] = -(w**2), -2 * self.mode_damping * w, w**2
        a[3, 3] = -1 / self.lag
        return CorrectedPlant(a, np.array([0.0, 0.0, 0.0, 1 / self.lag]), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True)
class HandRange(Options):
    """A person's hand and arm as a range of impedances; the defaults are our own.

    >>> gt.control.lead_through.HandRange().stiffness
    (0.0, 800.0)
    """

    mass: Annotated[Between, Unit("kg"), Within(least=0.0), "from and to"] = (0.0, 2.0)
    damping: Annotated[Between, Unit("N.s/m"), Within(least=0.0), "from and to"] = (2.0, 40.0)
    stiffness: Annotated[Between, Unit("N/m"), Within(least=0.0), "from and to"] = (0.0, 800.0)
    least_damping: Annotated[
        float, Within(least=0.0, below=1.0), "least damping ratio of every mode of the loop with every hand"
    ] = 0.05
    draws: Annotated[int, Within(least=1), "random hands in the range"] = 300
    seed: Annotated[int, Within(least=0), "of the random hands"] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in HANDS_BY:
            low, high = getattr(self, name)
            if low > high:
                raise ArgumentError(f"expected an increasing range; found {low:g} to {high:g}", name)


@dataclass(frozen=True)
class SyntheticReadings(Options):
    """Synthetic readings of a force sensor at rest in random poses, and during pushes against a fixed point.

    >>> gt.control.lead_through.SyntheticReadings(poses=12).pushes
    9
    """

    sensor: SyntheticSensor = field(default_factory=SyntheticSensor)
    poses: Annotated[int, Within(least=4), "random poses at rest, without contact"] = 24
    pushes: Annotated[int, Within(least=0), "in random directions, at the tool centre point; 0: none"] = 9
    push: Annotated[float, Unit("N"), Within(above=0.0), "force of a push"] = 20.0
    repetitions: Annotated[int, Within(least=0), "of the experiment, for the coverage of the intervals"] = 200
    seed: Annotated[int, Within(least=0), "of poses, pushes and noise"] = 1


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LeadThroughStudy(Study):
    """Guiding a tool by hand against a synthetic contact: forces, limits, energy, and stability with a hand.

    run: the synthetic run; book: its energy balance at the handle. Both are None if the sensors prevented or stopped
    the motion; a note says when.
    """

    run: ToolRun | None = None
    book: PassivityBook | None = None
    force_gain: Annotated[float, Quantity("m/s/N", "of the force control, (8.4)", "gain of the force control")] = 0.0
    loop_gain: Annotated[
        float, Quantity("1/s", "gain times contact stiffness; for a peg in its worst direction", "loop gain")
    ] = 0.0
    limit: Annotated[float, Quantity("1/s", "loop gain at the stability limit, from eigenvalues", "limit")] = 0.0
    frequency: Annotated[float, Quantity("Hz", "of the oscillation there", "frequency at the limit")] = 0.0
    simulated_limit: Annotated[
        float | None, Quantity("1/s", "loop gain at which runs in time begin to grow", "limit of runs in time")
    ] = None
    simulated_frequency: Annotated[
        float | None, Quantity("Hz", "of the growing oscillation", "frequency of runs in time")
    ] = None
    stiffnesses: Annotated[Sequence[float], Quantity("N/m", "of the range of contacts")] = ()
    gain_limits: Annotated[Sequence[float], Quantity("m/s/N", "greatest gain at each stiffness")] = ()
    mean_force: Annotated[float | None, Quantity("N", "along the true normal, in contact", "mean force")] = None
    force_deviation: Annotated[
        float | None, Quantity("N", "root mean square from the reference", "deviation of the force")
    ] = None
    least_force: Annotated[float | None, Quantity("N", "in settled contact", "least force")] = None
    peak_force: Annotated[float | None, Quantity("N", "over the whole run", "peak force")] = None
    force_frequency: Annotated[
        float | None, Quantity("Hz", "at which the force's spectrum is largest", "frequency of the force")
    ] = None
    contact_losses: Annotated[int | None, Quantity("", "without a release by the hand", "losses of contact")] = None
    normal_error: Annotated[
        float | None, Quantity("rad", "mean angle from the true normal", "error of the normal", "deg", "", "deg")
    ] = None
    gain_share: Annotated[
        float | None, Quantity("", "after reduction by the oscillation watch", "share of the gain left")
    ] = None
    energy_passed: Annotated[float | None, Quantity("J", "in both directions", "energy at the handle")] = None
    least_window: Annotated[float | None, Quantity("J", "energy supplied by the hand", "least over any window")] = None
    energy_deficit: Annotated[
        float | None, Quantity("J", "returned to the hand beyond the stored energy", "energy not stored before")
    ] = None
    hand_damping: Annotated[
        float | None, Quantity("", "damping ratio of the least damped pole over all hands", "least damping, any hand")
    ] = None
    hand_mode: Annotated[float | None, Quantity("Hz", "undamped frequency of that pole", "mode of least damping")] = (
        None
    )
    worst_hand: Annotated[Mapping[str, float], "its mass [kg], damping [N s/m] and stiffness [N/m]"] = field(
        default_factory=dict
    )
    stiffest_hand: Annotated[float | None, Quantity("N/m", "the loop is stable up to here", "stiffest stable hand")] = (
        None
    )
    cone_deviations: Annotated[
        Mapping[str, Sequence[float]] | None, Quantity("N", "of the force, for each cone", "deviation by cone")
    ] = None
    largest_torque: Annotated[float | None, Quantity("N.m", "on the peg, about its tip", "largest torque")] = None
    last_torque: Annotated[float | None, Quantity("N.m", "root mean square in the last second", "torque left")] = None
    misalignment: Annotated[
        Sequence[float] | None,
        Quantity("rad", "of peg and hole, at the beginning and the end", "misalignment", "deg", "", "deg"),
    ] = None
    depth: Annotated[float | None, Quantity("m", "of the tip in the hole", "depth", "mm", "", "mm")] = None
    undetermined: Annotated[
        Sequence[float] | None, "axis in the tool's frame about which the contact does not determine the rotation"
    ] = None
    turned_about: Annotated[
        float | None,
        Quantity("rad", "commanded about the peg's axis, in contact", "turn about the peg", "deg", "", "deg"),
    ] = None
    expected_about: Annotated[
        float | None,
        Quantity("rad", "standard deviation from the torque noise", "its random walk", "deg", "", "deg"),
    ] = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WrenchStudy(Study):
    """Bias of a force sensor, mass and centre of mass of its load, and point of application of forces."""

    poses: Annotated[int, Quantity("", "at rest", "poses")] = 0
    mass: Annotated[float | None, Quantity("kg", "of the sensor's load", "mass")] = None
    centre: Annotated[
        Sequence[float] | None, Quantity("m", "of mass, in the sensor's frame", "centre", "mm", "", "mm")
    ] = None
    force_bias: Annotated[Sequence[float], Quantity("N", "reading without force", "bias of the force")] = ()
    moment_bias: Annotated[Sequence[float], Quantity("N.m", "reading without moment", "bias of the moment")] = ()
    force_drift: Annotated[
        Sequence[float] | None, Quantity("N/s", "of the bias, with a linear drift", "drift of the force")
    ] = None
    moment_drift: Annotated[
        Sequence[float] | None, Quantity("N.m/s", "of the bias, with a linear drift", "drift of the moment")
    ] = None
    force_thermal: Annotated[
        Sequence[float] | None, Quantity("N/K", "of the bias with temperature", "thermal drift of the force")
    ] = None
    moment_thermal: Annotated[
        Sequence[float] | None, Quantity("N.m/K", "of the bias with temperature", "thermal drift of the moment")
    ] = None
    force_changes: Annotated[
        Mapping[str, Sequence[float]] | None,
        Quantity("N", "bias of each earlier session or block minus the last", "changes of the force's bias"),
    ] = None
    moment_changes: Annotated[
        Mapping[str, Sequence[float]] | None,
        Quantity("N.m", "bias of each earlier session or block minus the last", "changes of the moment's bias"),
    ] = None
    arm: Annotated[Sequence[float] | None, Quantity("m", "to the point of the pushes", "lever arm", "mm", "", "mm")] = (
        None
    )
    half_widths: Annotated[Mapping[str, float], "of 95 % intervals, by parameter, in N, kg, N m, kg m and m"] = field(
        default_factory=dict
    )
    usable: Annotated[str, "whether the wrench can be used: a `WrenchStatus`"] = ""
    coverage: Annotated[
        Mapping[str, float] | None, "share of synthetic repetitions with the truth in the 95 % interval, by parameter"
    ] = None
