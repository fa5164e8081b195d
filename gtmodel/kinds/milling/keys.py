"""The keys of kind "milling"."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from gtmodel.milling import AngleTable, Coefficients, Cut, Cutter, Oscillators, missing_z, options
from gtmodel.problem_files.base import Context, InputError, Section
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
SOURCES = ("oscillator", "modal", "oscillator_field")  # of dynamics; at most one


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

    def cutter(self) -> Cutter:
        """Raises InputError."""
        K = Coefficients(self.K_te_N_m, self.K_tc_Pa, self.K_re_N_m, self.K_rc_Pa, self.K_ae_N_m, self.K_ac_Pa)
        angles = None if self.tooth_angles_deg is None else np.deg2rad(self.tooth_angles_deg)
        runout = None if self.runout_m is None else np.array(self.runout_m)
        try:
            return Cutter(self.diameter_m, self.teeth, K, float(np.deg2rad(self.helix_deg)), angles, runout)
        except ValueError as error:
            raise InputError(str(error), "cutter") from error


class CutKeys(Section):
    """The cut."""

    mode: Literal["climb", "up", "slot"] = Field(description="climb is also called down milling")
    radial_depth_m: float = Field(description="width of the cut; at most the diameter; a slot does not read it")
    axial_depth_m: float = Field(description="depth of the cut along the tool")
    feed_per_tooth_m: float = Field(description="more than 0; where to is told by feed_direction")
    speed_rpm: float = Field(description="of the spindle, turns per minute")
    feed_direction: Three = Field(default=[1.0, 0.0, 0.0], description="across the tool axis, world coordinates")

    def cut(self) -> Cut:
        """Raises InputError."""
        try:
            return Cut(self.mode, self.radial_depth_m, self.axial_depth_m, self.feed_per_tooth_m)
        except ValueError as error:
            raise InputError(str(error), "cut") from error


class OscillatorRow(Section):
    """Measured dynamics of the tool at one angle."""

    angle_deg: float = Field(description="redundant angle A")
    m_kg: Three = Field(description="along x, y, z of the world")
    c_kg_s: Annotated[list[float], Field(min_length=2, max_length=3)] = Field(
        description="damping along x, y, z, the same as N.s/m; without z its damping ratio is the mean of the other two"
    )
    k_N_m: Three = Field(description="along x, y, z")

    def oscillators(self) -> Oscillators:
        """Raises ValueError."""
        if len(self.c_kg_s) == 3:
            return Oscillators(*(np.array([x]) for x in (self.m_kg, self.c_kg_s, self.k_N_m)))
        if min(*self.m_kg, *self.c_kg_s, *self.k_N_m) <= 0:
            raise ValueError("m, c and k must be positive")
        return missing_z(self.m_kg, [*self.c_kg_s, 1.0], self.k_N_m)


@made_from(options.Search, "speeds", "speed_range")
class Search(Made):
    """What may be chosen besides the angle."""

    speeds_rpm: list[float] = Field(default=[], description="spindle speeds to compare with the given one")
    speed_range_rpm: Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="least and greatest speed of an NLP over angle and speed together; none if left out"
    )

    def options(self) -> Any:
        """In turns per second."""
        between = self.speed_range_rpm and [rpm / 60 for rpm in self.speed_range_rpm]
        return replace(super().options(), speeds=[rpm / 60 for rpm in self.speeds_rpm], speed_range=between)


class Lobes(Section):
    """Stability lobes in the chosen pose."""

    from_rpm: PositiveFloat = Field(description="lowest spindle speed")
    to_rpm: PositiveFloat = Field(description="highest spindle speed")


class Schema(RobotProblem):
    """Where to mill: the angle about the spindle by static and dynamic deflection.

    At most one of [[oscillator]], [modal] and oscillator_field gives the dynamics.
    """

    place_m: Three = Field(description="of the tool centre point, world coordinates")
    tool: Made[options.Tool] = Made[options.Tool]()
    cutter: CutterKeys
    cut: CutKeys
    joint_stiffness_MNm_rad: list[PositiveFloat] = Field(
        min_length=6, max_length=6, description="by joint, for the static index"
    )
    limits_deg: list[list[float]] | None = Field(default=None, description="of the joints; those of the KR 500-3 else")
    oscillator: list[OscillatorRow] | None = Field(default=None, description="one table for each known angle")
    modal: Made[options.Modal] | None = Field(default=None, description="dynamics from joint stiffness")
    oscillator_field: str | None = Field(
        default=None, description="file of a Gaussian-process field over the poses, as kind dynamic_stiffness writes it"
    )
    search: Search = Search()
    lobes: Lobes | None = Field(default=None, description="stability lobes too")
    compensation: Made[options.PathOffset] | None = Field(default=None, description="compensation too")
    printed_tests: bool = Field(default=False, description="predict the twelve tests of Cvitanic 2021 too")

    def dynamics(self, context: Context) -> Any:
        """Where the dynamics come from; None where none are given. Raises InputError."""
        given = [k for k in SOURCES if getattr(self, k) is not None]
        if len(given) > 1:
            raise InputError(f"found {' and '.join(given)}; expected at most one source of dynamics", given[-1])
        if self.oscillator is not None:
            return _table(self.oscillator)
        if self.modal is not None:
            return self.modal.options()
        return None if self.oscillator_field is None else _field(self.oscillator_field, context)


def _table(rows: list[OscillatorRow]) -> AngleTable:
    if len(rows) < 2:
        said = f"holds {len(rows)} angles; expected two or more, between which dynamics are known"
        raise InputError(said, "oscillator")
    found = []
    for n, row in enumerate(rows):
        try:
            found.append(row.oscillators())
        except ValueError as error:
            raise InputError(str(error), f"oscillator[{n}]") from error
    try:
        return AngleTable(np.deg2rad([row.angle_deg for row in rows]), Oscillators.joined(found))
    except ValueError as error:
        raise InputError(str(error), "oscillator") from error


def _field(file: str, context: Context) -> Any:
    from gtmodel.vibration import load_oscillator_field

    path = context.folder / file
    try:
        field = load_oscillator_field(path)
    except ValueError as error:
        raise InputError(str(error), "oscillator_field") from error
    context.take("oscillator_field", path)
    return field
