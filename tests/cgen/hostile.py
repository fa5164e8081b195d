"""Inputs that a controller should never send: spoilt, tiny, huge, at the edge of what can be reached, stale."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gtmodel import Status
from gtmodel.cgen.interface import Interface
from gtmodel.cgen.verification.comparison import box_points, call

INSIDE = 0.01  # of a box's width, left out at both its ends
POINTS = 400  # random ones of the box that hostile rows start from
HALVINGS = 60  # from a point with an answer towards one without, until they are neighbours

ACROSS_M = 5.0  # more than twice a link's way along its guideway

Rows = np.ndarray


def inside(face: Interface, points: int, seed: int = 0) -> Rows:
    """Points of the declared box but for one hundredth of it at each side, with the state that leads there."""
    assert face.box is not None
    narrow = tuple((a + INSIDE * (b - a), b - INSIDE * (b - a)) for a, b in face.box)
    return box_points(replace(face, box=narrow), points, seed)


class Hostile:
    """Draws for one function of a library. `along`: (3,), a direction in which the robot may be pushed for ever."""

    def __init__(self, face: Interface, library: ctypes.CDLL, along: np.ndarray, seed: int) -> None:
        self.face, self.library, self.along = face, library, along
        self.rng = np.random.default_rng(seed)
        self.base = inside(face, POINTS, seed).astype(float)
        names = [m.signal for m in face.inputs for _ in range(m.size)]
        self.rates = np.array([name.startswith("der(") for name in names])
        self.kinds: list[Callable[[Rows], Rows]] = [
            self.spoilt, self.tiny, self.one_huge, self.all_sizes, self.pushed, self.millimetres, self.far_rates,
            self.edge, self.stale,
        ]  # fmt: skip
        if face.state:
            self.kinds.append(self.beyond)

    def rows(self, count: int) -> Rows:
        """About as many rows of each kind, in the numbers of the function."""
        each = -(-count // len(self.kinds))
        with np.errstate(over="ignore"):
            found = [kind(self.base[self.rng.integers(len(self.base), size=each)]) for kind in self.kinds]
        return self.face.real.array(np.concatenate(found)[:count])

    def _powers(self, shape: object, low: float, high: float) -> Rows:
        sign = self.rng.choice([-1.0, 1.0], size=shape)
        return sign * 10.0 ** self.rng.uniform(low, high, size=shape)

    def _some(self, rows: Rows) -> Rows:
        """Which numbers of each row: one to all."""
        share = self.rng.random((len(rows), 1))
        chosen = self.rng.random(rows.shape) < share
        chosen[np.arange(len(rows)), self.rng.integers(rows.shape[1], size=len(rows))] = True
        return chosen

    def spoilt(self, rows: Rows) -> Rows:
        bad = self.rng.choice([np.nan, np.inf, -np.inf], size=rows.shape)
        return np.where(self._some(rows), bad, rows)

    def tiny(self, rows: Rows) -> Rows:
        return np.where(self._some(rows), self._powers(rows.shape, -324, -3), rows)

    def one_huge(self, rows: Rows) -> Rows:
        column = self.rng.integers(rows.shape[1], size=len(rows))
        rows[np.arange(len(rows)), column] = self._powers(len(rows), 0, 300)
        return rows

    def all_sizes(self, rows: Rows) -> Rows:
        return self._powers(rows.shape, -300, 300)

    def pushed(self, rows: Rows) -> Rows:
        """All that has a place moved along the guideways, by up to 1e12 m, state included; a third to 1e300."""
        far = self._powers(len(rows), 0, 12)
        far[::3] = self._powers(len(far[::3]), 0, 300)
        for members, first in ((self.face.inputs, 0), (self.face.state, self.face.input_size)):
            for m in members:
                part = slice(first, first + m.size)
                if m.signal == "T":
                    rows[:, part] += far[:, None] * self.along
                elif m.signal.startswith("q"):
                    linear = 3 if m.size == 6 else m.size
                    rows[:, first : first + linear] += far[:, None] * (m.unit == "m" or m.size == 6)
                first += m.size
        return rows

    def beyond(self, rows: Rows) -> Rows:
        """The tool centre point, or the carts, moved along the guideways past each other: to the mirrored assembly."""
        n = self.face.input_size
        far = self.rng.uniform(-ACROSS_M, ACROSS_M, size=(len(rows), 1))
        first = 0
        for m in self.face.inputs:
            if m.signal in ("T", "q"):
                linear = self.along if m.signal == "T" else np.ones(3)
                rows[:, first : first + 3] += far * linear
            first += m.size
        rows[:, n:] += self._powers(rows[:, n:].shape, -6, -1) * np.abs(rows[:, n:])
        return rows

    def millimetres(self, rows: Rows) -> Rows:
        places = np.append(~self.rates, np.zeros(rows.shape[1] - len(self.rates), bool))
        rates = np.append(self.rates, np.zeros(rows.shape[1] - len(self.rates), bool))
        which = self.rng.integers(3, size=len(rows))[:, None]
        scaled = (which != 1) & places | (which != 0) & rates
        return np.where(scaled, 1e3 * rows, rows)

    def far_rates(self, rows: Rows) -> Rows:
        """Rates of every size, that also contradict each other."""
        columns = np.append(self.rates, np.zeros(rows.shape[1] - len(self.rates), bool))
        if not columns.any():
            return self.edge(rows)
        spread = self.rng.uniform(0, 12, size=(len(rows), 1))
        factors = self._powers(rows.shape, -1, 1)
        return np.where(columns, rows * np.sign(factors) * np.abs(factors) ** (spread / 2), rows)

    def edge(self, rows: Rows) -> Rows:
        """Where answers end: between a point that has one and a far one by bisection, then off by little or nothing."""
        n = self.face.input_size
        out = rows.copy()
        out[:, :n] += (
            self._powers((len(rows), 1), -0.5, 0.5)
            * self.rng.standard_normal((len(rows), n))
            * (np.max(np.abs(rows[:, :n]), axis=0) + 0.1)
        )
        low, high = rows.copy(), out
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            good = call(self.library, self.face, self.face.real.array(middle))[1] == Status.OK
            low[good], high[~good] = middle[good], middle[~good]
        off = self._powers((len(rows), 1), -17, -2) * (out - rows)
        return low + off * self.rng.integers(2, size=(len(rows), 1))

    def stale(self, rows: Rows) -> Rows:
        """States of other moments, far ones and zeros; without a state, inputs of other rows mixed."""
        n = self.face.input_size
        other = self.base[self.rng.integers(len(self.base), size=len(rows))]
        if rows.shape[1] == n:
            return np.where(self._some(rows), other, rows)
        state = rows[:, n:]
        near = state + self._powers(state.shape, -6, 1)
        scaled = state * self._powers(state.shape, -2, 2)
        which = self.rng.integers(4, size=len(rows))[:, None]
        rows[:, n:] = np.select([which == 0, which == 1, which == 2], [other[:, n:], near, scaled], 0.0)
        return rows
