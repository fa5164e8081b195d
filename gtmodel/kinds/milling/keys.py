"""The keys of kind "milling"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel.milling import Cut, Cutter, CuttingCoefficients, Oscillators, missing_z, options
from gtmodel.problem_files.base import Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.robot_keys import RobotProblem
from gtmodel.results.refusal import naming

if TYPE_CHECKING:
    from gtmodel.milling import AngleTable

RESULT = "gtmodel.milling.MillingStudy"

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
SOURCES = ("oscillator", "modal", "oscillator_field")  # of dynamics; at most one


@made_from(Cutter, "coefficients")
class CutterKeys(Made[CuttingCoefficients]):
    """A helical end mill, with cutting coefficients for the material."""

    def options(self) -> Any:
        """The cutter."""
        K = {name: getattr(self, key) for key, name in Made[CuttingCoefficients].attributes.items()}
        return Cutter(**self.given(), coefficients=CuttingCoefficients(**K))


@made_from(Cut)
class CutKeys(Made):
    """The cut."""

    speed_rpm: float = Field(description="of the spindle, turns per minute")
    feed_direction: Three = Field(default=[1.0, 0.0, 0.0], description="across the tool axis, world coordinates")


class OscillatorRow(FileSection):
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


@made_from(options.MillingSearch, "speeds", "speed_range")
class SearchSection(Made):
    """What may be chosen besides the angle."""

    speeds_rpm: list[float] = Field(default=[], description="spindle speeds to compare with the given one")
    speed_range_rpm: Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="least and greatest speed of an NLP over angle and speed together; none if left out"
    )

    def options(self) -> Any:
        """In turns per second."""
        between = self.speed_range_rpm and [rpm / 60 for rpm in self.speed_range_rpm]
        return options.MillingSearch(**self.given(), speeds=[rpm / 60 for rpm in self.speeds_rpm], speed_range=between)


class LobesSection(FileSection):
    """Stability lobes in the chosen pose."""

    from_rpm: PositiveFloat = Field(description="lowest spindle speed")
    to_rpm: PositiveFloat = Field(description="highest spindle speed")


class Schema(RobotProblem):
    """Where to mill: the angle about the spindle by static and dynamic deflection.

    At most one of [[oscillator]], [modal] and oscillator_field gives the dynamics.
    """

    place_m: Three = Field(description="of the tool centre point, world coordinates")
    tool: Made[options.MillingTool] = Made[options.MillingTool].left_out()
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
    search: SearchSection = SearchSection.left_out()
    lobes: LobesSection | None = Field(default=None, description="stability lobes too")
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
    from gtmodel.milling import AngleTable  # here: the keys alone need no CasADi

    if len(rows) < 2:
        said = f"holds {len(rows)} angles; expected two or more, between which dynamics are known"
        raise InputError(said, "oscillator")
    oscillators = []
    for n, row in enumerate(rows):
        with naming(f"oscillator[{n}]", ValueError):
            oscillators.append(row.oscillators())
    with naming("oscillator", ValueError):
        return AngleTable(np.deg2rad([row.angle_deg for row in rows]), Oscillators.concatenate(oscillators))


def _field(file: str, context: Context) -> Any:
    from gtmodel.vibration import load_oscillator_field

    path = context.folder / file
    with naming("oscillator_field", ValueError):
        field = load_oscillator_field(path)
    context.take("oscillator_field", path)
    return field
