"""What a calibration of joint stiffness asks for: the arm's set-up, columns of measured tests, synthetic tests."""

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
    rotation: Annotated[float, Unit("rad"), Within(above=0), "of each rotation; 20 um on a base of 0.25 m"] = 1e-4


@dataclass(frozen=True)
class GravityCompensator(Options):
    """A spring between two hinges at distances base and lever from axis 2; its change of torque adds to K_c.

    >>> spring = gt.compliance.GravityCompensator(base=0.3, lever=0.25, rate=8e5, rest=0.2)
    >>> gt.compliance.Setup(compensator=spring).compensator.estimate_rate
    False
    """

    base: Annotated[float, Unit("m"), Within(above=0), "from axis 2 to the hinge on the link before"]
    lever: Annotated[float, Unit("m"), Within(above=0), "from axis 2 to the hinge on the link after"]
    rate: Annotated[float, Unit("N/m"), Within(above=0), "of the spring; the start where it is estimated"]
    rest: Annotated[float, Unit("m"), Within(least=0), "length at which the spring is slack"]
    angle: Annotated[float, Unit("rad", written="deg"), "of joint 2 where the spring is longest"] = 0.0
    estimate_rate: Annotated[bool, "whether the rate is an unknown too; complete_pose only"] = False


@dataclass(frozen=True)
class Setup(Options):
    """How joint stiffness is identified from static load tests.

    >>> gt.compliance.Setup(method="complete")
    Traceback (most recent call last):
    gtmodel...: method: expected one of complete_pose, decoupled; found 'complete'; did you mean complete_pose?
    """

    tool: Annotated[list[float], Unit("m"), Long(3), "tool centre point in flange coordinates"] = field(
        default_factory=lambda: [0.0] * 3
    )
    method: Annotated[Literal["complete_pose", "decoupled"], "the one reported first"] = "complete_pose"
    complementary: Annotated[bool, "count the loads' complementary stiffness K_c"] = False
    compensator: Annotated[GravityCompensator | None, "of joint 2, part of K_c"] = None
    best: Annotated[int, Within(least=1), "how many tests that determine most are listed"] = 10
    noise: Annotated[Noise, "of the measured displacements"] = field(default_factory=Noise)


@dataclass(frozen=True)
class LoadTestColumn(Options):
    """The columns of one quantity in a file, with their unit.

    >>> gt.compliance.LoadTestColumn("q", "deg")  # q[0], q[1], ... of the file
    LoadTestColumn(column='q', unit='deg')
    >>> gt.compliance.LoadTestColumn(["Fx", "Fy", "Fz"], ["N", "N", "kN"]).unit
    ['N', 'N', 'kN']
    """

    column: Annotated[str | list[str], 'names in the file; "q" means "q[0]", "q[1]", ... too']
    unit: Annotated[str | list[str], "unit of the columns, or one each"]


@dataclass(frozen=True, kw_only=True)
class LoadTests(Options):
    """The columns of measured tests: joint angles, loads and displacements, one test in each row. World coordinates.

    >>> from gtmodel.compliance import LoadTestColumn, LoadTests
    >>> tests = LoadTests(
    ...     q=LoadTestColumn("q", "deg"), force=LoadTestColumn("F", "N"),
    ...     displacement=LoadTestColumn("d", "mm"), rotation=LoadTestColumn("r", "rad"),
    ... )
    >>> tests.moment is None  # the load was a force alone
    True
    """

    q: Annotated[LoadTestColumn, "joint angles"]
    force: Annotated[LoadTestColumn, "on the tool centre point"]
    moment: Annotated[LoadTestColumn | None, "about it; none if left out"] = None
    displacement: Annotated[LoadTestColumn, "of the tool centre point, with the load less without"]
    rotation: Annotated[LoadTestColumn, "of the tool, as a rotation vector"]
    wrist: Annotated[LoadTestColumn | None, "displacement of a target at the wrist centre; by the pose if left out"] = (
        None
    )


@dataclass(frozen=True, kw_only=True)
class SyntheticTests(Options):
    """Synthetic tests of known stiffness, to see what identification gives back.

    >>> gt.compliance.SyntheticTests(stiffness=[2e6, 2e6, 2e6, 1e6, 0.0, 2e5], seed=1)
    Traceback (most recent call last):
    gtmodel...: stiffness: must be more than 0; found 0
    """

    stiffness: Annotated[list[float], Unit("N.m/rad", written="MN.m/rad"), Within(above=0), "by joint"]
    tilt: Annotated[
        float, Within(least=0),
        "compliance of bearings across their axes, in units of the joint's; the model lacks it",
    ] = 0.0  # fmt: skip
    wrist_target: Annotated[bool, "whether the wrist centre has a target of its own"] = True
    seed: Annotated[int, "of the noise"]
