"""Discriminants of the closed forms along a motion: where one touches zero, its root would be reflected."""

from __future__ import annotations

from functools import cached_property

import casadi as ca
import numpy as np

from .over_rows import OverRows
from .reduced import Reduced

# a minimum of a discriminant, relative to its typical size, that is zero within the accuracy of the motion;
# an integrator's tolerance adds up to some thousand times itself over a long run
TOUCH, TOUCH_TOLERANCES = 1e-7, 1e3
# near enough to a touch that the parabola through two points gives its minimum
CLOSE = 100.0
# a minimum between two points is well distinguished from zero where it keeps this part of the smaller end
KEPT = 0.25
# and the rates at the two ends must explain the change between them up to this part of the larger one
EXPLAINED = 0.3
# of a number that has been computed
ROUND_OFF = 8 * np.finfo(float).eps


class Watched:
    """Expressions of a reduced system with their rates along the motion."""

    def __init__(self, reduced: Reduced, watched: ca.SX) -> None:
        d = watched
        x, z, t, f = reduced.x, reduced.z, reduced.t, reduced.rates
        self.count = d.numel()
        rate = ca.densify(ca.jacobian(d, t) + ca.mtimes(ca.jacobian(d, x), f))
        arguments = [x, z, t, reduced.p]
        self._values = OverRows(ca.Function("watched", arguments, [d, rate]))
        # Newton unknowns move too: rz z' = -(rx x' + rt)
        r = reduced.residuals
        moved = ca.densify(ca.jacobian(r, t) + ca.mtimes(ca.jacobian(r, x), f))
        by_z, rz = ca.densify(ca.jacobian(d, z)), ca.densify(ca.jacobian(r, z))
        self.moved_by_inputs = bool(ca.jacobian(d, reduced.p).nnz())
        self._arguments, self._watched = arguments, d
        uses_z = bool(ca.jacobian(d, z).nnz())
        self._through_z = ca.Function("through", arguments, [by_z, rz, moved]) if uses_z else None

    def __call__(
        self, xs: np.ndarray, zs: np.ndarray, times: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values and their rates [1/s], one row for each time."""
        values, rates = self._values(xs, zs, times[:, None], p)
        if self._through_z is not None:
            rates = rates.copy()
            for n, (x, z, t) in enumerate(zip(xs, zs, times, strict=True)):
                by_z, rz, moved = (np.asarray(v.full()) for v in self._through_z(x, z, t, p))
                try:
                    rates[n] -= by_z @ np.linalg.solve(rz, moved.reshape(-1))
                except np.linalg.LinAlgError:
                    rates[n] = np.nan
        return values, rates

    @cached_property
    def _by_unknowns(self) -> ca.Function:
        x, z = self._arguments[:2]
        derivatives = ca.horzcat(ca.jacobian(self._watched, x), ca.jacobian(self._watched, z))
        return ca.Function("by_unknowns", self._arguments, [ca.fabs(ca.densify(derivatives))])

    def round_off(
        self, x: np.ndarray, z: np.ndarray, time: float, p: np.ndarray, x_scale: np.ndarray, z_scale: np.ndarray
    ) -> np.ndarray:
        """Of the values at one point: what round-off of states and Newton unknowns, which are of the size of their
        nominals or larger, moves them by; 0 for those whose slope is not finite there."""
        sizes = np.maximum(np.abs(np.append(x, z)), np.append(x_scale, z_scale))
        moved = np.asarray(self._by_unknowns(x, z, time, p).full()) @ (ROUND_OFF * sizes)
        return np.where(np.isfinite(moved), moved, 0.0)

    def values(self, x: np.ndarray, z: np.ndarray, time: float, p: np.ndarray) -> np.ndarray:
        """Values at one point for columns of table pieces, one row for each column."""
        return self._values(x, z, np.array([time]), p.T)[0]


class Roots(Watched):
    """Watches every discriminant, in units of its typical size, with its rate."""

    def __init__(self, reduced: Reduced, tolerance: float) -> None:
        margins = [(m, e) for m, e in reduced.margin_expressions if m.kind == "discriminant"]
        self.labels = [m.label for m, _ in margins]
        self._touch = max(TOUCH, TOUCH_TOLERANCES * tolerance)
        super().__init__(reduced, ca.vertcat(*[e / m.scale for m, e in margins]) if margins else ca.SX(0, 1))

    def __bool__(self) -> bool:
        return self.count > 0

    def judge(self, times: np.ndarray, values: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, list[str], float]:
        """For each interval between neighbouring rows whether it is resolved, and the labels of what touches zero in
        the first that is not, and when: for these the motion is at its end."""
        h = np.diff(times)[:, None]
        a, b, da, db = values[:-1], values[1:], rates[:-1] * h, rates[1:] * h
        smaller, larger = np.minimum(a, b), np.maximum(a, b)
        explained = np.abs(b - a - (da + db) / 2) <= EXPLAINED * larger
        turns = (da < 0) & (db > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = np.where(turns, -da / (db - da), 0.0)  # where a parabola with these rates has its minimum
        # the cubic through both ends with their rates
        lowest = (1 + 2 * s) * (1 - s) ** 2 * a + s * (1 - s) ** 2 * da + s**2 * (3 - 2 * s) * b + s**2 * (s - 1) * db
        touching = turns & (lowest <= self._touch) & (smaller <= CLOSE * self._touch)
        resolved = explained & ~touching & (~turns | (lowest >= KEPT * smaller))
        good = np.all(resolved, axis=1)
        first = int(np.argmin(good)) if not good.all() else 0
        touch = np.flatnonzero(touching[first]) if not good.all() else []
        when = float(times[first] + h[first, 0] * min((s[first, j] for j in touch), default=0.0))
        return good, [self.labels[j] for j in touch], when
