"""Published lines of friction: their levels, and the mass anew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...lang import Model
from ...results import Row, SolveStatus, Work
from ...results.door import study_function
from ...results.work import Progress, never, silent
from .gravity import mass_by_norm
from .options import FrictionCoefficients, HeldPose
from .pattern import gravity_pattern
from .study import LABELS, FrictionStudy, by_norm, check_widths

WARNING = "the runs do not tell the mass while friction may differ by direction; every mass gives the same forces"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PublishedFriction(FrictionStudy):
    """Friction of published lines with the mass that makes it most symmetric.

    `chosen` is the published mass [kg]; `asymmetry` the size of what it leaves between the directions, 2-norm [N], of
    which `objective` is the least.
    """

    chosen: float
    asymmetry: float

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        norms, least = self.mass_by_norm or {}, self.objective or 0.0
        return [
            Row("published mass", self.chosen, "kg"),
            Row("mass of most symmetric friction (2-norm)", self.mass, "kg"),
            Row("1-norm: least anywhere from", f"{norms['one'][0]:.4g} to {norms['one'][1]:.4g}", "kg"),
            Row("maximum norm", norms["maximum"], "kg"),
            Row("asymmetry, 2-norm: published", self.asymmetry, "N"),
            Row("asymmetry, 2-norm: least", least, "N"),
            Row("why they differ", f"the minimum is flat: {self.asymmetry - least:.2g} N are not seen by eye"),
            *self._coefficients(),
        ]


@study_function
def published_friction_study(
    robot: Model,
    published: FrictionCoefficients,
    pose: HeldPose,
    *,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> PublishedFriction:
    """The mass of most symmetric friction from printed lines, which hold for one pose.

    Args:
        robot: as of `friction_study`.
        published: friction by cart, with the mass that was chosen for it.
        pose: where the tool was held.
        progress, max_seconds, stop: see `gtmodel.results.Work`; the work is done at once.

    Raises ArgumentError for coefficients of another number of carts, and for a pose as `gravity_pattern` does.

    >>> lines = gt.identify.FrictionCoefficients(
    ...     [189.0, 262.0, 239.0], [145.0, 119.0, 177.0], [205.0] * 3, [158.0] * 3, mass=22.4
    ... )
    >>> pose = gt.identify.HeldPose(holding=[-177.0, -15.0, 191.0], holding_mass=22.4)
    >>> s = gt.identify.published_friction_study(gt.robots.gantry_tau("l1_tape"), lines, pose)
    >>> round(s.mass, 1), s.asymmetry > s.objective
    (22.7, True)
    """
    Work(progress=progress, max_seconds=max_seconds, stop=stop).progress("reading", 0.2)
    pattern = gravity_pattern(robot, [pose])
    g = pattern[0]
    check_widths(published, g.size, "published")
    lines: dict[str, Any] = {name: np.array(getattr(published, name)) for name in LABELS}
    middle = published.mass * g + (lines["coulomb_plus"] - lines["coulomb_minus"]) / 2
    norms = mass_by_norm(middle, g)
    change = (norms.two - published.mass) * g
    shifted = {"coulomb_plus": lines["coulomb_plus"] - change, "coulomb_minus": lines["coulomb_minus"] + change}
    size = [float(np.linalg.norm(middle - m * g)) for m in (published.mass, norms.two)]
    return PublishedFriction(
        status=SolveStatus.SOLVED,
        message=f"most symmetric at {norms.two:.4g} kg, published {published.mass:g} kg",
        title=title,
        objective=size[1],
        mass=norms.two,
        mass_by_norm=by_norm(norms),
        **(lines | shifted),
        middle=middle[None],
        pattern=pattern,
        intervals={},
        notes=[WARNING],
        chosen=published.mass,
        asymmetry=size[0],
        figures={"friction": partial(_figure, lines, published.mass, g, norms.two, title or "published friction")},
    )


def _figure(lines: dict[str, np.ndarray], chosen: float, g: np.ndarray, mass: float, title: str) -> Any:
    from ...plot.friction import friction_figure

    def line(i: int, v: np.ndarray) -> np.ndarray:
        plus, minus, forth, back = (lines[name][i] for name in LABELS)
        return chosen * g[i] + np.where(v > 0, plus + forth * v, -minus + back * v)

    return friction_figure([], [partial(line, i) for i in range(g.size)], mass * g, title=title)
