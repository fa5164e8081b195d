"""Kind "milling": best angle about the spindle for milling, from static and dynamic deflection."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel import milling, robots, vibration
from gtmodel.milling import Cut, Cutter, CuttingCoefficients, Oscillators, missing_z, options
from gtmodel.problem_files.base import Call, Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results.refusal import naming

if TYPE_CHECKING:
    from gtmodel.milling import AngleTable

RESULT = "gtmodel.milling.MillingStudy"

Three = Annotated[list[float], Field(min_length=3, max_length=3)]
SOURCES = ("oscillator", "modal", "oscillator_field")  # at most one of them defines the dynamics


@made_from(Cutter, "coefficients")
class CutterKeys(Made[CuttingCoefficients]):
    """A helical end mill, with cutting coefficients for the material."""

    def options(self) -> Any:
        """Return the cutter."""
        K = {name: getattr(self, key) for key, name in Made[CuttingCoefficients].attributes.items()}
        return Cutter(**self.given(), coefficients=CuttingCoefficients(**K))


@made_from(Cut)
class CutKeys(Made):
    """The cut."""

    speed_rpm: float = Field(description="spindle speed, revolutions per minute")
    feed_direction: Three = Field(
        default=[1.0, 0.0, 0.0], description="feed direction, orthogonal to the tool axis, world coordinates"
    )


class OscillatorRow(FileSection):
    """Measured dynamics of the tool at one angle."""

    angle_deg: float = Field(description="redundant angle A")
    m_kg: Three = Field(description="mass along x, y, z of the world")
    c_kg_s: Annotated[list[float], Field(min_length=2, max_length=3)] = Field(
        description="damping along x, y, z, in kg/s = N.s/m; without z, its damping ratio is the mean of the others"
    )
    k_N_m: Three = Field(description="stiffness along x, y, z")

    def oscillators(self) -> Oscillators:
        """Return the oscillators. Raises ValueError."""
        if len(self.c_kg_s) == 3:
            return Oscillators(*(np.array([x]) for x in (self.m_kg, self.c_kg_s, self.k_N_m)))
        if min(*self.m_kg, *self.c_kg_s, *self.k_N_m) <= 0:
            raise ValueError("m, c and k must be positive")
        return missing_z(self.m_kg, [*self.c_kg_s, 1.0], self.k_N_m)


@made_from(options.MillingSearch, "speeds", "speed_range")
class SearchSection(Made):
    """Choices besides the angle."""

    speeds_rpm: list[float] = Field(default=[], description="spindle speeds to compare with cut.speed_rpm")
    speed_range_rpm: Annotated[list[PositiveFloat], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="lowest and highest speed of an NLP over angle and speed; no NLP if left out"
    )

    def options(self) -> Any:
        """Return the options, with speeds in revolutions per second."""
        between = self.speed_range_rpm and [rpm / 60 for rpm in self.speed_range_rpm]
        return options.MillingSearch(**self.given(), speeds=[rpm / 60 for rpm in self.speeds_rpm], speed_range=between)


class LobesSection(FileSection):
    """Stability lobes in the chosen pose."""

    from_rpm: PositiveFloat = Field(description="lowest spindle speed")
    to_rpm: PositiveFloat = Field(description="highest spindle speed")


class Schema(RobotProblem):
    """Best angle about the spindle for milling, from static and dynamic deflection.

    At most one of [[oscillator]], [modal] and oscillator_field defines the dynamics.
    """

    place_m: Three = Field(description="position of the tool centre point, world coordinates")
    tool: Made[options.MillingTool] = Made[options.MillingTool].left_out()
    cutter: CutterKeys
    cut: CutKeys
    joint_stiffness_MNm_rad: list[PositiveFloat] = Field(
        min_length=6, max_length=6, description="stiffness of each joint, for the static index"
    )
    limits_deg: list[list[float]] | None = Field(
        default=None, description="limits of the joints; those of the KR 500-3 if left out"
    )
    oscillator: list[OscillatorRow] | None = Field(default=None, description="one table for each known angle")
    modal: Made[options.Modal] | None = Field(default=None, description="dynamics from joint stiffness")
    oscillator_field: str | None = Field(
        default=None, description="file of a Gaussian-process field over the poses, written by kind dynamic_stiffness"
    )
    search: SearchSection = SearchSection.left_out()
    lobes: LobesSection | None = Field(default=None, description="also compute stability lobes")
    compensation: Made[options.PathOffset] | None = Field(default=None, description="also compensate the deflection")
    printed_tests: bool = Field(default=False, description="also predict the twelve tests of Cvitanic 2021")

    def dynamics(self, context: Context) -> Any:
        """Return the source of the dynamics, or None. Raises InputError."""
        sources = [k for k in SOURCES if getattr(self, k) is not None]
        if len(sources) > 1:
            raise InputError(f"found {' and '.join(sources)}; expected at most one source of dynamics", sources[-1])
        if self.oscillator is not None:
            return _table(self.oscillator)
        if self.modal is not None:
            return self.modal.options()
        return None if self.oscillator_field is None else _field(self.oscillator_field, context)


def _table(rows: list[OscillatorRow]) -> AngleTable:
    if len(rows) < 2:
        raise InputError(f"has {len(rows)} angles; expected at least two, to interpolate the dynamics", "oscillator")
    oscillators = []
    for n, row in enumerate(rows):
        with naming(f"oscillator[{n}]", ValueError):
            oscillators.append(row.oscillators())
    with naming("oscillator", ValueError):
        return milling.AngleTable(np.deg2rad([row.angle_deg for row in rows]), Oscillators.concatenate(oscillators))


def _field(file: str, context: Context) -> Any:
    path = context.folder / file
    with naming("oscillator_field", ValueError):
        field = vibration.load_oscillator_field(path)
    context.take("oscillator_field", path)
    return field


def arguments(problem: Schema) -> dict[str, str]:
    """Return the keys of the study's arguments."""
    source = next((k for k in SOURCES if getattr(problem, k) is not None), "")
    return {
        "speed": "cut.speed_rpm",
        "feed": "cut.feed_direction",
        "search.speeds": "search.speeds_rpm",
        "cutter.coefficients": "cutter",
        "dynamics": source,
        "lobes": "lobes.to_rpm" if source else "lobes",
    }


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the place in the file and its alternatives."""
    limits, lobes = problem.limits_deg, problem.lobes
    keywords = options_of(problem, "cutter", "cut", "tool", "search", "compensation")
    return Call(
        milling.study, problem.model(context), keywords.pop("cutter"), keywords.pop("cut"), place=problem.place_m,
        speed=problem.cut.speed_rpm / 60, feed=problem.cut.feed_direction,
        joint_stiffness=[1e6 * k for k in problem.joint_stiffness_MNm_rad], **keywords,
        dynamics=problem.dynamics(context), source=problem.oscillator_field or "",
        limits=limits and [np.deg2rad(row).tolist() for row in limits],
        lobes=lobes and (lobes.from_rpm / 60, lobes.to_rpm / 60),
        tests=robots.kr500_tables() if problem.printed_tests else None, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the alternatives and the cut."""
    study = call(problem, context)
    later = ("lobes", "compensation", "tests")
    task = milling.task.task_of(*study.arguments, **{k: v for k, v in study.options.items() if k not in later})
    s, lag = task.search, np.rad2deg(task.cutter.lag(task.cut.axial_depth))
    counts = [1 + len(x) for x in (s.places, s.feed_directions, s.speeds)]
    return "\n".join(
        [
            f"{problem.heading}: {round(2 * np.pi / s.step) + 1} angles, {counts[0]} places, {counts[1]} feeds, "
            f"{counts[2]} speeds",
            f"{task.cut.mode} milling with {task.cutter.teeth} teeth at {task.speed * task.cutter.teeth:.4g} Hz; the "
            f"helix lags by {lag:.3g} deg over the depth",
            "forces: Cvitanic 2021, eqs. (12)-(17); static index |K^-1 F_peak| (18), dynamic index max |x(t)| (19)",
            f"dynamics: {task.whence or 'none, static index only'}",
        ]
    )
