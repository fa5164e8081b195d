"""What cuts and how: cutter, cut, and what each tooth meets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ..results import ArgumentError
from ..results.agreement import agree
from ..results.options import Options, Unit, Within

Mode = Literal["climb", "up", "slot"]


class Coefficients(NamedTuple):
    """Edge (e) [N/m] and cutting (c) [N/m2] coefficients, tangential, radial and axial (Cvitanic 2021, Table 3)."""

    K_te: float
    K_tc: float
    K_re: float
    K_rc: float
    K_ae: float
    K_ac: float

    @property
    def edge(self) -> np.ndarray:
        """(3,) tangential, radial, axial [N/m]."""
        return np.array([self.K_te, self.K_re, self.K_ae])

    @property
    def cutting(self) -> np.ndarray:
        """(3,) tangential, radial, axial [N/m2]."""
        return np.array([self.K_tc, self.K_rc, self.K_ac])


@dataclass(frozen=True, eq=False)
class Cutter(Options):
    """A helical end mill with `coefficients` for the material it cuts.

    diameter [m]; teeth; helix [rad], right-handed, 0 for straight teeth. tooth_angles (teeth,) [rad]: of the teeth
    at the tip, rising, within one turn; even pitch if left out. runout (teeth,) [m]: by how much each tooth stands
    out radially. Raises ArgumentError for impossible values.
    """

    diameter: Annotated[float, Unit("m"), Within(above=0.0)]
    teeth: Annotated[int, Within(least=1)]
    coefficients: Coefficients
    helix: Annotated[float, Unit("rad"), Within(least=0.0, below=np.pi / 2)] = 0.0
    tooth_angles: np.ndarray | None = None
    runout: np.ndarray | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        agree(tuple(self.coefficients), tuple[float, ...], "coefficients")
        k = self.coefficients
        if k.K_tc < 0 or k.K_te < 0:
            name, value = ("K_tc", k.K_tc) if k.K_tc < 0 else ("K_te", k.K_te)
            raise ArgumentError(
                f"is {value:g}; expected 0 or more, for a chip brakes the tooth and does not drive it",
                f"coefficients.{name}",
            )
        for name in ("tooth_angles", "runout"):
            given = getattr(self, name)
            if given is not None and (np.shape(given) != (self.teeth,) or not np.all(np.isfinite(given))):
                raise ArgumentError(f"has the shape {np.shape(given)}; expected {self.teeth} finite numbers", name)
        if np.any(self.pitch <= 0):
            raise ArgumentError("must rise and lie within one turn", "tooth_angles")

    @property
    def radius(self) -> float:
        """[m]"""
        return self.diameter / 2

    @property
    def angles(self) -> np.ndarray:
        """(teeth,) angle of each tooth at the tip [rad]."""
        if self.tooth_angles is None:
            return 2 * np.pi * np.arange(self.teeth) / self.teeth
        return np.asarray(self.tooth_angles, float)

    @property
    def pitch(self) -> np.ndarray:
        """(teeth,) angle from each tooth to the one that cuts before it [rad]."""
        return np.diff(np.append(self.angles, self.angles[0] + 2 * np.pi))

    def lag(self, depth: float) -> float:
        """Angle by which the helix trails at an axial depth [m]: a_p tan(beta)/R [rad]."""
        return depth * np.tan(self.helix) / self.radius


@dataclass(frozen=True)
class Cut(Options):
    """mode "climb" (down), "up" or "slot"; radial_depth a_e, axial_depth a_p and feed_per_tooth f_t, all [m].

    A slot takes the whole diameter, its radial_depth is not read. Raises ArgumentError for impossible values.
    """

    mode: Mode
    radial_depth: Annotated[float, Unit("m"), Within(above=0.0)]
    axial_depth: Annotated[float, Unit("m"), Within(above=0.0)]
    feed_per_tooth: Annotated[
        float, Unit("m"), Within(above=0.0, advice="the direction of feed is a vector of its own")
    ]


class Teeth(NamedTuple):
    """What teeth meet, a row for each stretch of a tooth's way on which its chip is left by the same tooth before it.

    The tooth at angle [rad] of the cutter cuts from `start` to `end` [rad] with force (K_e + K_c offset) + K_c feed
    sin(phi): chip thickness feed sin(phi) + offset, feed and offset [m]. All (rows,).
    """

    angle: np.ndarray
    start: np.ndarray
    end: np.ndarray
    feed: np.ndarray
    offset: np.ndarray


def immersion(mode: str, radial_depth: float, diameter: float) -> tuple[float, float]:
    """Angles phi_st, phi_ex [rad] between which a tooth cuts, from the transverse axis in its sense of turning.

    Climb: pi - acos(1 - a_e/R) to pi; up: 0 to acos(1 - a_e/R); slot: 0 to pi. Raises ValueError for a radial depth
    beyond the diameter.
    """
    if mode == "slot":
        return 0.0, np.pi
    if radial_depth > diameter:
        raise ValueError(f"the radial depth {radial_depth:g} m is more than the diameter {diameter:g} m; reduce it")
    width = float(np.arccos(1 - 2 * radial_depth / diameter))
    return (np.pi - width, np.pi) if mode == "climb" else (0.0, width)


def teeth_in_cut(cutter: Cutter, cut: Cut) -> Teeth:
    """Engagement of each tooth, with its pitch and runout.

    A tooth's chip ends at the outermost of the surfaces that the teeth before it left, its own last turn the farthest
    back: what a short tooth leaves is there for the next. Where nothing is left a tooth does not cut.
    """
    ends = immersion(cut.mode, cut.radial_depth, cutter.diameter)
    out = np.zeros(cutter.teeth) if cutter.runout is None else np.asarray(cutter.runout, float)
    rows = []
    for i, angle in enumerate(cutter.angles):
        back = (i + 1 + np.arange(cutter.teeth)) % cutter.teeth
        feeds = cut.feed_per_tooth * cutter.teeth * np.cumsum(np.roll(cutter.pitch, -i)) / (2 * np.pi)
        rows += [(angle, *row) for row in _stretches(feeds, out[i] - out[back], *ends)]
    return Teeth(*np.array(rows, float).reshape(-1, 5).T)


def _stretches(
    feeds: np.ndarray, offsets: np.ndarray, start: float, end: float
) -> list[tuple[float, float, float, float]]:  # fmt: skip
    """From, to, feed and offset where the least of feeds sin(phi) + offsets is positive."""
    if not offsets.any():
        return [(start, end, float(feeds[0]), 0.0)]
    with np.errstate(divide="ignore", invalid="ignore"):
        equal = (offsets[None, :] - offsets[:, None]) / (feeds[:, None] - feeds[None, :])
        sines = np.concatenate([equal.ravel(), -offsets / feeds])
    angles = np.arcsin(sines[(sines > 0) & (sines < 1)])
    inner = np.unique(np.concatenate([angles, np.pi - angles]))
    edges = np.concatenate([[start], inner[(inner > start) & (inner < end)], [end]])
    found: list[tuple[float, float, float, float]] = []
    for a, b in pairwise(edges.tolist()):
        chips = feeds * np.sin((a + b) / 2) + offsets
        k = int(np.argmin(chips))
        if chips[k] <= 0:
            continue
        line = (float(feeds[k]), float(offsets[k]))
        if found and found[-1][1] == a:
            # no angle belongs to two stretches
            before = found.pop()
            found.append((before[0], b if before[2:] == line else float(np.nextafter(a, 0)), *before[2:]))
            if before[2:] == line:
                continue
        found.append((a, b, *line))
    return found


def tooth_frequency(speed: float, teeth: int) -> float:
    """Tooth passing frequency [Hz] of a spindle speed [1/s], eq. (20). Raises ValueError unless that is positive."""
    if not speed > 0 or not np.isfinite(speed):
        raise ValueError(f"the spindle speed is {60 * speed:g} rpm; expected more than 0")
    return speed * teeth
