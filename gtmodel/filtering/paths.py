"""Paths at constant speed in closed form, so that ideal sensor readings along them are exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from ..results.options import Options, Unit, Within
from ..results.refusal import ArgumentError

PathKind = Literal["sine", "line", "semicircle"]
PANELS = 400  # per period of the sine, for its arc length; with five nodes each it is exact to round-off
NEWTON = 6


@dataclass(frozen=True)
class TrackedPath(Options):
    """A path of the target in the x-z plane at constant speed, and the rotation of the body along it.

    `axes` 3: the body does not turn. 5: it turns about y; the tool axis stays normal to a sine, or turns by `turn` in
    total along a line or a semicircle. Cvitanic 2021, 4.2.2 and 4.2.3.

    >>> motion = gt.filtering.TrackedPath(axes=5).motion(np.array([0.0, 1.83]))
    >>> motion.v.round(4).tolist(), np.degrees(motion.angle).round(1).tolist()
    ([[0.0045, 0.0, 0.0421], [0.0369, 0.0, 0.0207]], [83.9, 29.3])
    """

    kind: Annotated[PathKind, "sine, line or semicircle"] = "sine"
    axes: Annotated[Literal[3, 5], "3: the body does not turn; 5: it turns about y along the path"] = 3
    feed: Annotated[float, Unit("m/s", written="mm/s"), Within(above=0.0), "speed along the path"] = 0.04233
    duration: Annotated[float, Unit("s"), Within(above=0.0), "of the motion"] = 5.0
    amplitude: Annotated[float, Unit("m"), Within(above=0.0), "of the sine"] = 0.0762
    cycles: Annotated[float, Unit("1/m"), Within(above=0.0), "periods of the sine per metre along x"] = 19.685
    radius: Annotated[float, Unit("m"), Within(above=0.0), "of the semicircle"] = 0.25
    turn: Annotated[float, Unit("rad", written="deg"), "total rotation of the body on a line or semicircle"] = np.pi / 3

    def motion(self, time: np.ndarray) -> BodyMotion:
        """Return the motion of the body at these times [s] since the start."""
        s = self.feed * np.asarray(time, float)
        v = self.feed
        shapes = {"sine": self._sine, "line": self._line, "semicircle": self._semicircle}
        p, theta, curvature, change = shapes[self.kind](s)
        tangent = np.stack([np.cos(theta), np.zeros_like(s), np.sin(theta)], axis=1)
        normal = np.stack([-np.sin(theta), np.zeros_like(s), np.cos(theta)], axis=1)
        if self.kind == "sine":
            angle, rate, acceleration = theta, v * curvature, v * v * change
        else:
            length = v * self.duration
            angle, rate, acceleration = self.turn * s / length, np.full_like(s, self.turn * v / length), 0 * s
        if self.axes == 3:
            angle, rate, acceleration = 0 * s, 0 * s, 0 * s
        about = np.array([0.0, -1.0, 0.0])  # x turns towards z about -y
        Q = np.stack([np.cos(angle / 2), 0 * s, -np.sin(angle / 2), 0 * s], axis=1)
        return BodyMotion(
            np.asarray(time, float), p, v * tangent, (v * v * curvature)[:, None] * normal, Q, rate[:, None] * about,
            acceleration[:, None] * about, angle,
        )  # fmt: skip

    def _sine(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        k, A = 2 * np.pi * self.cycles, self.amplitude

        def slope(x: np.ndarray) -> np.ndarray:
            return A * k * np.cos(k * x)

        end = float(np.max(s)) if s.size else 0.0
        grid = np.linspace(0.0, end + 1e-12, int(np.ceil(PANELS * max(1.0, end * self.cycles))) + 1)
        nodes, weights = np.polynomial.legendre.leggauss(5)
        h = grid[1] - grid[0]
        inside = grid[:-1, None] + h * (nodes + 1) / 2
        along = np.concatenate([[0.0], np.cumsum(np.sqrt(1 + slope(inside) ** 2) @ weights * h / 2)])
        x = np.interp(s, along, grid)
        for _ in range(NEWTON):  # the arc length within the panel is integrated again
            panel = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, len(grid) - 2)
            rest = (x - grid[panel])[:, None] * (nodes + 1) / 2
            speeds = np.sqrt(1 + slope(grid[panel][:, None] + rest) ** 2)
            length = along[panel] + speeds @ weights * (x - grid[panel]) / 2
            x = x + (s - length) / np.sqrt(1 + slope(x) ** 2)
        g, g1, g2 = slope(x), -A * k**2 * np.sin(k * x), -A * k**3 * np.cos(k * x)
        root = np.sqrt(1 + g * g)
        p = np.stack([x, np.zeros_like(x), A * np.sin(k * x)], axis=1)
        return p, np.arctan(g), g1 / root**3, (g2 / root**3 - 3 * g * g1**2 / root**5) / root

    def _line(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        zero = np.zeros_like(s)
        return np.stack([s, zero, zero], axis=1), zero, zero, zero

    def _semicircle(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        if np.max(s, initial=0.0) > np.pi * self.radius * (1 + 1e-9):
            longest = np.pi * self.radius / self.feed
            sentence = f"the semicircle ends after {longest:.4g} s at this feed; found {self.duration:g} s"
            raise ArgumentError(sentence, "duration")
        theta = np.pi / 2 - s / self.radius
        p = self.radius * np.stack([1 - np.sin(theta), 0 * s, np.cos(theta)], axis=1)
        return p, theta, np.full_like(s, -1 / self.radius), np.zeros_like(s)


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Motion of a body at instants `time` (k,) [s]: position p, velocity v, acceleration a (k, 3) in the world,
    orientation Q (k, 4), body to world, angular velocity w and acceleration alpha (k, 3) in the axes of the body, and
    angle of rotation (k,) [rad]."""

    time: np.ndarray
    p: np.ndarray
    v: np.ndarray
    a: np.ndarray
    Q: np.ndarray
    w: np.ndarray
    alpha: np.ndarray
    angle: np.ndarray
