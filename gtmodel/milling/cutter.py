"""Cutter, cut, and the engagement of each tooth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ..results import ArgumentError, Options, Unit, Within

Mode = Literal["climb", "up", "slot"]
PER_DEPTH = "edge force per depth"
PER_CHIP = "cutting force per depth and chip thickness"


@dataclass(frozen=True)
class CuttingCoefficients(Options):
    """Cutting coefficients of a material: edge (e) [N/m] and cutting (c) [N/m2], tangential, radial and axial (Cvitanic
    2021, Table 3).

    Tangential coefficients must not be negative, as a chip cannot drive the tooth. Raises ArgumentError otherwise.

    >>> K = gt.milling.CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8)  # 900 N/mm2 = 9e8 Pa
    >>> K.cutting / 1e6  # tangential, radial, axial [N/mm2]
    array([900., 300.,   0.])
    """

    K_te: Annotated[float, Unit("N/m"), Within(least=0.0), f"{PER_DEPTH}, tangential"]
    K_tc: Annotated[float, Unit("Pa"), Within(least=0.0), f"{PER_CHIP}, tangential"]
    K_re: Annotated[float, Unit("N/m"), f"{PER_DEPTH}, radial"]
    K_rc: Annotated[float, Unit("Pa"), f"{PER_CHIP}, radial"]
    K_ae: Annotated[float, Unit("N/m"), f"{PER_DEPTH}, axial"] = 0.0
    K_ac: Annotated[float, Unit("Pa"), f"{PER_CHIP}, axial"] = 0.0

    @property
    def edge(self) -> np.ndarray:
        """Edge coefficients (3,), tangential, radial, axial [N/m]."""
        return np.array([self.K_te, self.K_re, self.K_ae])

    @property
    def cutting(self) -> np.ndarray:
        """Cutting coefficients (3,), tangential, radial, axial [N/m2]."""
        return np.array([self.K_tc, self.K_rc, self.K_ac])


@dataclass(frozen=True, eq=False)
class Cutter(Options):
    """A helical end mill, right-handed, with cutting coefficients for the material.

    tooth_angles (teeth,) [rad] and runout (teeth,) [m] apply at the tip; runout is positive outwards. Raises
    ArgumentError for invalid values.

    >>> K = gt.milling.CuttingCoefficients(K_te=6e3, K_tc=9e8, K_re=7e3, K_rc=3e8)
    >>> cutter = gt.milling.Cutter(diameter=0.02, teeth=2, coefficients=K, helix=np.radians(30.0))
    >>> round(np.degrees(cutter.lag(0.002)), 1)  # by which the helix trails at a depth of 2 mm
    np.float64(6.6)
    >>> gt.milling.Cutter(0.02, 2, K, helix=30.0)  # degrees
    Traceback (most recent call last):
        ...
    gtmodel.results.refusal.ArgumentError: helix: must be at least 0 and less than 1.5708; found 30
    """

    diameter: Annotated[float, Unit("m"), Within(above=0.0), "diameter of the cutter"]
    teeth: Annotated[int, Within(least=1), "number of teeth"]
    coefficients: CuttingCoefficients
    helix: Annotated[
        float, Unit("rad", written="deg"), Within(least=0.0, below=np.pi / 2), "helix angle; 0 for straight teeth"
    ] = 0.0  # fmt: skip
    tooth_angles: Annotated[
        list[float] | None, Unit("rad", written="deg"), "rising angles of the teeth at the tip; default: even pitch"
    ] = None  # fmt: skip
    runout: Annotated[list[float] | None, Unit("m"), "radial runout of each tooth, positive outwards"] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.teeth != int(self.teeth):
            raise ArgumentError(f"is {self.teeth}; expected a whole number", "teeth")
        for name in ("tooth_angles", "runout"):
            values = getattr(self, name)
            if values is not None and np.shape(values) != (self.teeth,):
                raise ArgumentError(f"has the shape {np.shape(values)}; expected {self.teeth} numbers", name)
        if np.any(self.pitch <= 0):
            raise ArgumentError("must rise and lie within one turn", "tooth_angles")

    @property
    def radius(self) -> float:
        """Radius of the cutter [m]."""
        return self.diameter / 2

    @property
    def angles(self) -> np.ndarray:
        """Angle of each tooth at the tip (teeth,) [rad]."""
        if self.tooth_angles is None:
            return 2 * np.pi * np.arange(self.teeth) / self.teeth
        return np.asarray(self.tooth_angles, float)

    @property
    def pitch(self) -> np.ndarray:
        """Angle from each tooth to the tooth that cuts before it (teeth,) [rad]."""
        return np.diff(np.append(self.angles, self.angles[0] + 2 * np.pi))

    def lag(self, depth: float) -> float:
        """Return the lag angle of the helix at an axial depth [m]: a_p tan(beta)/R [rad]."""
        return depth * np.tan(self.helix) / self.radius


@dataclass(frozen=True)
class Cut(Options):
    """The engagement of the cutter: sense of the cut, depths and feed. A slot has the full diameter as width.

    Raises ArgumentError for invalid values.

    >>> cut = gt.milling.Cut("climb", radial_depth=0.006, axial_depth=0.002, feed_per_tooth=1e-4)
    >>> gt.milling.Cut("conventional", 0.006, 0.002, 1e-4)
    Traceback (most recent call last):
        ...
    gtmodel.results.agreement.WrongKind: mode: expected one of climb, up, slot; found 'conventional'
    """

    mode: Annotated[Mode, "climb is also called down milling"]
    radial_depth: Annotated[
        float, Unit("m"), Within(above=0.0), "width of the cut, at most the diameter; a slot does not use it"
    ]
    axial_depth: Annotated[float, Unit("m"), Within(above=0.0), "depth of the cut along the tool"]
    feed_per_tooth: Annotated[float, Unit("m"), Within(above=0.0), "feed of the cutter per tooth; more than 0"]


class Teeth(NamedTuple):
    """Engagement, one row per angular interval of a tooth in which the same previous tooth left its chip.

    The tooth at angle [rad] of the cutter cuts from `start` to `end` [rad] with force (K_e + K_c offset) + K_c feed
    sin(phi): chip thickness feed sin(phi) + offset, feed and offset [m]. All (rows,).
    """

    angle: np.ndarray
    start: np.ndarray
    end: np.ndarray
    feed: np.ndarray
    offset: np.ndarray


def immersion(mode: str, radial_depth: float, diameter: float) -> tuple[float, float]:
    """Return entry and exit angle phi_st, phi_ex [rad] of a tooth, from the transverse axis in the sense of rotation.

    Climb: pi - acos(1 - a_e/R) to pi; up: 0 to acos(1 - a_e/R); slot: 0 to pi. Raises ValueError for a radial depth
    beyond the diameter.

    >>> np.degrees(gt.milling.immersion("climb", radial_depth=0.005, diameter=0.02)).round(6)
    array([120., 180.])
    """
    if mode == "slot":
        return 0.0, np.pi
    if radial_depth > diameter:
        raise ValueError(f"the radial depth {radial_depth:g} m is more than the diameter {diameter:g} m; reduce it")
    width = float(np.arccos(1 - 2 * radial_depth / diameter))
    return (np.pi - width, np.pi) if mode == "climb" else (0.0, width)


def teeth_in_cut(cutter: Cutter, cut: Cut) -> Teeth:
    """Return the engagement of each tooth, with pitch and runout.

    The chip of a tooth is bounded by the deepest of the surfaces left by all teeth within the last turn, itself
    included: material left by a short tooth remains for the next. A tooth without a chip does not cut.
    """
    ends = immersion(cut.mode, cut.radial_depth, cutter.diameter)
    runout = np.zeros(cutter.teeth) if cutter.runout is None else np.asarray(cutter.runout, float)
    rows = []
    for i, angle in enumerate(cutter.angles):
        back = (i + 1 + np.arange(cutter.teeth)) % cutter.teeth
        feeds = cut.feed_per_tooth * cutter.teeth * np.cumsum(np.roll(cutter.pitch, -i)) / (2 * np.pi)
        rows += [(angle, *row) for row in _stretches(feeds, runout[i] - runout[back], *ends)]
    return Teeth(*np.array(rows, float).reshape(-1, 5).T)


def _stretches(
    feeds: np.ndarray, offsets: np.ndarray, start: float, end: float
) -> list[tuple[float, float, float, float]]:  # fmt: skip
    """Return start, end, feed and offset of intervals in which the least of feeds sin(phi) + offsets is positive."""
    if not offsets.any():
        return [(start, end, float(feeds[0]), 0.0)]
    with np.errstate(divide="ignore", invalid="ignore"):
        equal = (offsets[None, :] - offsets[:, None]) / (feeds[:, None] - feeds[None, :])
        sines = np.concatenate([equal.ravel(), -offsets / feeds])
    angles = np.arcsin(sines[(sines > 0) & (sines < 1)])
    inner = np.unique(np.concatenate([angles, np.pi - angles]))
    edges = np.concatenate([[start], inner[(inner > start) & (inner < end)], [end]])
    stretches: list[tuple[float, float, float, float]] = []
    for a, b in pairwise(edges.tolist()):
        chips = feeds * np.sin((a + b) / 2) + offsets
        k = int(np.argmin(chips))
        if chips[k] <= 0:
            continue
        line = (float(feeds[k]), float(offsets[k]))
        if stretches and stretches[-1][1] == a:
            # no angle belongs to two intervals
            before = stretches.pop()
            stretches.append((before[0], b if before[2:] == line else float(np.nextafter(a, 0)), *before[2:]))
            if before[2:] == line:
                continue
        stretches.append((a, b, *line))
    return stretches


def tooth_frequency(speed: float, teeth: int) -> float:
    """Return the tooth passing frequency [Hz] at a spindle speed [1/s] (Cvitanic 2021, eq. (20)).

    Raises ValueError unless the speed is positive.

    >>> gt.milling.tooth_frequency(speed=1800 / 60, teeth=2)
    60.0
    """
    if not speed > 0 or not np.isfinite(speed):
        raise ValueError(f"the spindle speed is {60 * speed:g} rpm; expected more than 0")
    return speed * teeth
