"""The keys of kind "milling"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.problem_files.base import Section
from gtmodel.problem_files.robot_keys import RobotProblem

Three = Annotated[list[float], Field(min_length=3, max_length=3)]


class Tool(Section):
    """Where the tool sits on the flange, and how it is held over the work."""

    tcp_m: Three = Field(default=[0.0] * 3, description="tool centre point in flange coordinates")
    spindle: Three = Field(default=[0.0, 0.0, 1.0], description="direction from spindle to tip, flange coordinates")
    axis: Three = Field(default=[0.0, 0.0, -1.0], description="the same direction in world coordinates")
    zero_deg: float = Field(
        default=0.0, description="turn about the spindle at A = 0; at turn 0 the flange's z axis points to world x"
    )


class CutterKeys(Section):
    """A helical end mill, with cutting coefficients for the material."""

    diameter_m: float = Field(description="of the cutter")
    teeth: PositiveInt = Field(description="how many")
    helix_deg: NonNegativeFloat = Field(default=0.0, description="helix angle; 0 for straight teeth")
    K_te_N_m: float = Field(description="edge force per depth, tangential")
    K_tc_Pa: float = Field(description="cutting force per depth and chip thickness, tangential")
    K_re_N_m: float = Field(description="edge force per depth, radial")
    K_rc_Pa: float = Field(description="cutting force per depth and chip thickness, radial")
    K_ae_N_m: float = Field(default=0.0, description="edge force per depth, axial")
    K_ac_Pa: float = Field(default=0.0, description="cutting force per depth and chip thickness, axial")
    tooth_angles_deg: list[float] | None = Field(default=None, description="of uneven pitch, rising; even if left out")
    runout_m: list[float] | None = Field(default=None, description="by how much each tooth stands out")


class CutKeys(Section):
    """The cut."""

    mode: Literal["climb", "up", "slot"] = Field(description="climb is also called down milling")
    radial_depth_m: float = Field(description="width of the cut; at most the diameter; a slot does not read it")
    axial_depth_m: float = Field(description="depth of the cut along the tool")
    feed_per_tooth_m: float = Field(description="more than 0; where to is told by feed_direction")
    speed_rpm: float = Field(description="of the spindle, turns per minute")
    feed_direction: Three = Field(default=[1.0, 0.0, 0.0], description="across the tool axis, world coordinates")


class OscillatorRow(Section):
    """Measured dynamics of the tool at one angle."""

    angle_deg: float = Field(description="redundant angle A")
    m_kg: Three = Field(description="along x, y, z of the world")
    c_kg_s: Annotated[list[float], Field(min_length=2, max_length=3)] = Field(
        description="damping along x, y, z, the same as N.s/m; without z its damping ratio is the mean of the other two"
    )
    k_N_m: Three = Field(description="along x, y, z")


class Modal(Section):
    """Dynamics made from joint stiffness: k along x, y, z from the pose's compliance, with these masses."""

    mass_kg: Three = Field(description="along x, y, z, in every pose")
    damping_ratio: Three = Field(description="along x, y, z, in every pose")


class Search(Section):
    """What may be chosen besides the angle."""

    step_deg: PositiveFloat = Field(default=1.0, description="of the angle's grid over 360 degrees")
    speeds_rpm: list[float] = Field(default=[], description="spindle speeds to compare with the given one")
    feed_directions: list[Three] = Field(default=[], description="to compare with the given one")
    places_m: list[Three] = Field(default=[], description="of the tool centre point, to compare with the given one")
    static_choice_deg: float | None = Field(
        default=None, description="angle that a static model chose elsewhere, in print for one, to compare with"
    )
    refine: int = Field(default=3, ge=0, description="how many of the best angles are refined by an NLP")
    speed_range_rpm: Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="least and greatest speed of an NLP over angle and speed together; none if left out"
    )


class Lobes(Section):
    """Stability lobes in the chosen pose."""

    from_rpm: PositiveFloat = Field(description="lowest spindle speed")
    to_rpm: PositiveFloat = Field(description="highest spindle speed")


class CompensationKeys(Section):
    """A path offset against the deflection in the chosen pose, the force rising over `entry_s`."""

    bandwidth_Hz: PositiveFloat = Field(default=5.0, description="of offsets that the robot can follow")
    seconds: PositiveFloat = Field(default=2.0, description="of cutting")
    entry_s: PositiveFloat = Field(default=0.5, description="from the first chip to the full cut")
    cycle_s: PositiveFloat = Field(default=0.004, description="between the rows of compensation.csv")


class Schema(RobotProblem):
    """Where to mill: the angle about the spindle by static and dynamic deflection.

    At most one of [[oscillator]], [modal] and oscillator_field gives the dynamics.
    """

    place_m: Three = Field(description="of the tool centre point, world coordinates")
    tool: Tool = Tool()
    cutter: CutterKeys
    cut: CutKeys
    joint_stiffness_MNm_rad: list[PositiveFloat] = Field(
        min_length=6, max_length=6, description="by joint, for the static index"
    )
    limits_deg: list[list[float]] | None = Field(default=None, description="of the joints; those of the KR 500-3 else")
    oscillator: list[OscillatorRow] | None = Field(default=None, description="one table for each known angle")
    modal: Modal | None = Field(default=None, description="dynamics from joint stiffness")
    oscillator_field: str | None = Field(
        default=None, description="file of a Gaussian-process field over the poses, as kind dynamic_stiffness writes it"
    )
    search: Search = Search()
    lobes: Lobes | None = Field(default=None, description="stability lobes too")
    compensation: CompensationKeys | None = Field(default=None, description="compensation too")
    printed_tests: bool = Field(default=False, description="predict the twelve tests of Cvitanic 2021 too")
