"""Options of a joint stiffness calibration: the arm's set-up, columns of measured tests, synthetic tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from ...results.options import Long, Options, Unit, Within


@dataclass(frozen=True)
class Noise(Options):
    """Standard deviations of the measured displacements.

    >>> gt.compliance.Noise(position=0.0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: position: must be more than 0; found 0
    """

    position: Annotated[float, Unit("m"), Within(above=0), "of each coordinate, at tool and wrist centre"] = 2e-5
    rotation: Annotated[float, Unit("rad"), Within(above=0), "of each rotation; 20 um on a base of 0.2 m"] = 1e-4


@dataclass(frozen=True)
class GravityCompensator(Options):
    """A spring between two hinges at distances base and lever from axis 2; the change of its torque adds to K_c.

    >>> spring = gt.compliance.GravityCompensator(base=0.3, lever=0.25, rate=8e5, rest=0.2)
    >>> gt.compliance.Setup(compensator=spring).compensator.estimate_rate
    False
    """

    base: Annotated[float, Unit("m"), Within(above=0), "distance from axis 2 to the hinge on the preceding link"]
    lever: Annotated[float, Unit("m"), Within(above=0), "distance from axis 2 to the hinge on the following link"]
    rate: Annotated[float, Unit("N/m"), Within(above=0), "spring rate; start value if it is estimated"]
    rest: Annotated[float, Unit("m"), Within(least=0), "length of the unloaded spring"]
    angle: Annotated[float, Unit("rad", written="deg"), "angle of joint 2 at which the spring is longest"] = 0.0
    estimate_rate: Annotated[bool, "whether to estimate the rate; complete_pose only"] = False


@dataclass(frozen=True)
class Setup(Options):
    """Options for identifying joint stiffness from static load tests.

    >>> gt.compliance.Setup(method="complete")
    Traceback (most recent call last):
    gtmodel...: method: expected one of complete_pose, decoupled; found 'complete'; did you mean complete_pose?
    """

    tool: Annotated[list[float], Unit("m"), Long(3), "tool centre point in flange coordinates"] = field(
        default_factory=lambda: [0.0] * 3
    )
    method: Annotated[Literal["complete_pose", "decoupled"], "method that is reported first"] = "complete_pose"
    complementary: Annotated[bool, "whether to include the loads' complementary stiffness K_c"] = False
    compensator: Annotated[GravityCompensator | None, "gravity compensator of joint 2, part of K_c"] = None
    best: Annotated[int, Within(least=1), "number of most informative tests to list"] = 10
    noise: Annotated[Noise, "standard deviations of the measured displacements"] = field(default_factory=Noise)


@dataclass(frozen=True)
class LoadTestColumn(Options):
    """The columns of one quantity in a file, with their unit.

    >>> gt.compliance.LoadTestColumn("q", "deg")  # q[0], q[1], ... of the file
    LoadTestColumn(column='q', unit='deg')
    >>> gt.compliance.LoadTestColumn(["Fx", "Fy", "Fz"], ["N", "N", "kN"]).unit
    ['N', 'N', 'kN']
    """

    column: Annotated[str | list[str], 'names in the file; "q" also means "q[0]", "q[1]", ...']
    unit: Annotated[str | list[str], "unit of the columns, or one each"]


@dataclass(frozen=True, kw_only=True)
class LoadTests(Options):
    """The columns of measured tests: joint angles, loads and displacements, one test per row, in world coordinates.

    >>> from gtmodel.compliance import LoadTestColumn, LoadTests
    >>> tests = LoadTests(
    ...     q=LoadTestColumn("q", "deg"), force=LoadTestColumn("F", "N"),
    ...     displacement=LoadTestColumn("d", "mm"), rotation=LoadTestColumn("r", "rad"),
    ... )
    >>> tests.moment is None  # the load was a force alone
    True
    """

    q: Annotated[LoadTestColumn, "joint angles"]
    force: Annotated[LoadTestColumn, "force on the tool centre point"]
    moment: Annotated[LoadTestColumn | None, "moment about it; none if left out"] = None
    displacement: Annotated[LoadTestColumn, "displacement of the tool centre point, loaded less unloaded"]
    rotation: Annotated[LoadTestColumn, "rotation of the tool, as a rotation vector"]
    wrist: Annotated[LoadTestColumn | None, "displacement of a target at the wrist centre; default from the pose"] = (
        None
    )
    leave_out: Annotated[list[int], "lines of the file whose tests are not read, such as outliers"] = field(
        default_factory=list
    )


@dataclass(frozen=True, kw_only=True)
class SyntheticTests(Options):
    """Synthetic tests of known stiffness, to test the identification.

    >>> gt.compliance.SyntheticTests(stiffness=[2e6, 2e6, 2e6, 1e6, 0.0, 2e5], seed=1)
    Traceback (most recent call last):
    gtmodel...: stiffness: must be more than 0; found 0
    """

    stiffness: Annotated[list[float], Unit("N.m/rad", written="MN.m/rad"), Within(above=0), "stiffness by joint"]
    tilt: Annotated[
        float, Within(least=0),
        "compliance of bearings across their axes, relative to the joint's; the fitted model lacks it",
    ] = 0.0  # fmt: skip
    wrist_target: Annotated[bool, "whether the wrist centre has a separate target"] = True
    seed: Annotated[int, "seed of the noise"]
