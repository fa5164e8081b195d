"""The choice of the state variables at a point, and its monitoring along the motion.

Each stage of the structural analysis solves for as many columns of the system Jacobian as it has rows; the other
columns are states. A choice degrades if its solved columns C become singular while other columns would not.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection
from copy import copy
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiler.matrices import pivoted_qr
from ..compiler.plan import CausalPlan
from ..compiler.rows import PointFunction
from ..compiler.states import Stage, chosen_columns, stage_choices
from ..lang.source import ModelError
from .reduced import OverRows

# below this fraction of the best conditioning, new states are chosen
SWITCH_BELOW = 0.3
# limit of |C^-1 dC| for a prediction, and for rows compared with one inverse: C stays invertible, and a root keeps its
# sign
PREDICTED_CHANGE = 0.4
# limit from one row to the next: beyond it, the prediction failed
LARGEST_CHANGE = 0.8
# relative column norm below which there is no choice left, as in compiler.states
RANK_TOLERANCE = 1e-8

# the solved columns of each stage that had a choice
Choice = tuple[tuple[int, ...], ...]
# rows and columns of a stage's matrix
Part = tuple[tuple[int, ...], tuple[int, ...]]
# rows first compared with one inverse; and every how many rows are checked before checking all
ROWS = 64
STRIDE = 8


def choice_of(stages: list[Stage]) -> Choice:
    return tuple(tuple(sorted(s.matched.values())) for s in stage_choices(stages))


class StateSelection:
    """Chooses states and rates a choice, from the system Jacobian at any point over `plan.pairs`. `varied` are the
    parameters that stay symbols in the plan, `numbers` their values."""

    def __init__(self, plan: CausalPlan, prefer: frozenset[int], varied: ca.SX, numbers: np.ndarray) -> None:
        self._plan, self._prefer, self._numbers = plan, prefer, numbers
        flat, structure = plan.flat, plan.structure
        arguments = [plan.sampler.w, flat.scope.time, varied]
        self._system = PointFunction(ca.Function("system", arguments, [ca.densify(plan.system)]))
        self._stages = stage_choices(plan.stages)
        self._nominal = np.array([flat.variables[i].nominal for i in structure.unknowns])
        self._parts = {
            part: OverRows(
                ca.Function("stage", arguments, [ca.vec(ca.densify(plan.system[list(part[0]), list(part[1])]))])
            )
            for part in map(_part, self._stages)
        }
        self._distinct_parts: dict[Choice, list[Watch]] = {}
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        # position of each symbol's first and second derivative; the last entry of an extended point is zero
        self._next = [[place.get((i, k + m), -1) for i, k in plan.pairs] for m in (1, 2)]
        self._foreseen: _Foreseen | None = None

    def with_numbers(self, numbers: np.ndarray) -> StateSelection:
        """Return a copy with other values of the varied parameters."""
        selection = copy(self)
        selection._numbers, selection._foreseen = numbers, None
        return selection

    @property
    def has_choice(self) -> bool:
        return bool(self._stages)

    def matrix(self, w: np.ndarray, time: float) -> np.ndarray:
        return self._system(w, time, self._numbers)[0]

    # -- choosing ----------------------------------------------------------------------------------

    def choose(self, w: np.ndarray, time: float) -> Choice | None:
        """Return the solved columns at a point: those that keep the preferred states if these are good enough, else the
        best conditioned ones; None if no choice is valid."""
        m = self.matrix(w, time)
        if not np.all(np.isfinite(m)):
            return None
        plan = self._plan
        try:
            chosen = chosen_columns(plan.flat, plan.structure, m, self._prefer)
        except ModelError:
            return None
        preferred = tuple(tuple(sorted(columns)) for columns in chosen)
        if self.quality(preferred, m, SWITCH_BELOW) >= SWITCH_BELOW:
            return preferred
        best = self._best(m)
        return best if best is not None and self.quality(best, m) > 0.0 else preferred

    def preferred_beside(self, states: Collection[int]) -> list[str]:
        """Return the names of the preferred variables that are not in `states`."""
        return [self._plan.flat.variables[i].name for i in sorted(self._prefer) if i not in states]

    def states(self, choice: Choice) -> list[int]:
        """Return the indices of the variables whose columns a choice leaves unsolved."""
        columns = {j for s, solved in zip(self._stages, choice, strict=True) for j in s.columns if j not in solved}
        return sorted(self._plan.structure.unknowns[j] for j in columns)

    def _best(self, m: np.ndarray) -> Choice | None:
        """Return the best conditioned columns, stage by stage; columns solved in one stage stay solved in the next."""
        choice: list[tuple[int, ...]] = []
        solved: list[int] = []
        for stage in self._stages:
            a = self._scaled(m, stage)
            place = {j: n for n, j in enumerate(stage.columns)}
            first = [place[j] for j in solved if j in place]
            q = np.linalg.qr(a[:, first])[0] if first else np.zeros((len(stage.rows), 0))
            rest = [n for n in range(len(stage.columns)) if n not in set(first)]
            _, r, order = pivoted_qr(a[:, rest] - q @ (q.T @ a[:, rest]), "economic")
            count = len(stage.rows) - len(first)
            if count and np.abs(r[count - 1, count - 1]) <= RANK_TOLERANCE * np.abs(r[0, 0]):
                return None
            solved = sorted(stage.columns[n] for n in [*first, *(rest[k] for k in order[:count])])
            choice.append(tuple(solved))
        return tuple(choice)

    # -- watching ----------------------------------------------------------------------------------

    def quality(self, choice: Choice, m: np.ndarray, enough: float = np.inf) -> float:
        """Return the quality of a choice for the system Jacobian m, 1 for the best possible; a lower bound suffices if
        it is at least `enough`."""
        if not np.all(np.isfinite(m)):
            return 0.0
        quality = 1.0
        for watch in self._distinct(choice):
            quality = min(quality, watch.quality(m[watch.place] * watch.nominal, enough))
            if not quality > 0.0:
                break
        return quality

    def good_rows(self, choice: Choice, points: np.ndarray, times: np.ndarray, below: float) -> int:
        """Return how many rows after the first a choice is valid for. Between valid rows there is no singular pose,
        neither from the points nor from the prediction with their rates, and the quality stays above `below`; the row
        at which it falls below is the last one.

        If every STRIDE-th row passes, the rows between are not checked.
        """
        last, seen = len(times) - 1, self._foreseen
        if last == 1 and seen is not None and seen.holds(choice, points[0], times):
            # the prediction is good, and the last row need not be better than that
            return int(all(
                _changes(inverse, self._matrices(watch, points[1:], times[1:])[:, :, watch.solved])[0] <= LARGEST_CHANGE
                for watch, inverse in zip(self._distinct(choice), seen.inverses, strict=True)
            ))  # fmt: skip
        some = np.append(np.arange(0, last, STRIDE), last)
        if last > STRIDE:
            good = self._good_rows(choice, points[some], times[some], below, between=True)
            if good == len(some) - 1:
                return last
            first = int(some[good])
        else:
            first = 0
        return first + self._good_rows(choice, points[first:], times[first:], below)

    def _good_rows(
        self, choice: Choice, points: np.ndarray, times: np.ndarray, below: float, between: bool = False
    ) -> int:
        """Like `good_rows`, checking every row. `between`: stop where rows between the given ones may be bad."""
        ahead = self._ahead(points[:-1], np.diff(times))
        good = len(ahead)
        for watch in self._distinct(choice):
            both = np.vstack([points[: good + 1], ahead[:good]])
            matrices = self._matrices(watch, both, np.append(times[: good + 1], times[1 : good + 1]))
            good = _good_rows(matrices[:, : good + 1], matrices[:, good + 1 :], watch, below, between)
        return good

    def foresees(self, choice: Choice, w: np.ndarray, time: float, span: float) -> bool:
        """Return whether the solved columns stay good over a time [s] if the present motion continues."""
        both = np.vstack([w, self._ahead(w[None, :], np.array([span]))])
        inverses: list[np.ndarray] = []
        for watch in self._distinct(choice):
            c = self._matrices(watch, both, np.array([time, time + span]))[:, :, watch.solved]
            try:
                inverse = np.linalg.inv(c[:, 0])
            except np.linalg.LinAlgError:
                return False
            if not _changes(inverse, c[:, 1:])[0] <= PREDICTED_CHANGE:
                return False
            inverses.append(inverse)
        self._foreseen = _Foreseen(choice, w, time, span, inverses)
        return True

    def _ahead(self, points: np.ndarray, spans: np.ndarray) -> np.ndarray:
        """Extrapolate each point over a time [s] with its first and second derivatives."""
        with_zero, h = np.column_stack([points, np.zeros(len(points))]), spans[:, None]
        rate, curve = (with_zero[:, index] for index in self._next)
        return points + h * rate + h**2 / 2 * curve

    def _matrices(self, watch: Watch, points: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return the matrix of a stage, scaled by nominals, at points: (equations, points, columns)."""
        rows, columns = watch.part
        entries = self._parts[watch.part](points, times[:, None], self._numbers)[0]
        return entries.reshape(len(points), len(columns), len(rows)).transpose(2, 0, 1) * watch.nominal

    def _distinct(self, choice: Choice) -> list[Watch]:
        """Return each distinct stage with the positions of the solved columns among its columns."""
        if choice not in self._distinct_parts:
            places = [tuple(map(s.columns.index, solved)) for s, solved in zip(self._stages, choice, strict=True)]
            parts = dict.fromkeys(zip(map(_part, self._stages), places, strict=True))
            self._distinct_parts[choice] = [Watch(p, list(solved), self._nominal[list(p[1])]) for p, solved in parts]
        return self._distinct_parts[choice]

    def _scaled(self, m: np.ndarray, stage: Stage) -> np.ndarray:
        """Return the stage's matrix, scaled by nominals, with rows scaled to maximum 1."""
        return _with_unit_rows(m[np.ix_(stage.rows, stage.columns)] * self._nominal[stage.columns])


@dataclass(frozen=True, eq=False)
class _Foreseen:
    """A choice that `foresees` found good from a point over a time [s], with the inverse of each stage's columns."""

    choice: Choice
    w: np.ndarray
    time: float
    span: float
    inverses: list[np.ndarray]

    def holds(self, choice: Choice, w: np.ndarray, times: np.ndarray) -> bool:
        """Return whether it was for these two instants, from this point."""
        return bool(
            times[0] == self.time and times[1] - times[0] == self.span and choice == self.choice
            and np.array_equal(w, self.w)
        )  # fmt: skip


def _part(stage: Stage) -> Part:
    return tuple(stage.rows), tuple(stage.columns)


def _with_unit_rows(a: np.ndarray) -> np.ndarray:
    size = np.max(np.abs(a), axis=1, keepdims=True)
    return a / np.where(size > 0, size, 1.0)


class Watch:
    """A stage, `part`, with the positions of its solved columns, along a motion."""

    def __init__(self, part: Part, solved: list[int], nominal: np.ndarray) -> None:
        self.part, self.solved, self.nominal = part, solved, nominal
        self.place = np.ix_(*part)
        # a matrix with the smallest singular values of its solved and of all columns
        self._known = np.full((len(part[0]), len(part[1])), np.nan), 0.0, 0.0

    def quality(self, a: np.ndarray, enough: float = np.inf) -> float:
        """Return the smallest singular value of the solved columns relative to that of the best choice; a lower bound
        suffices if it is at least `enough`."""
        a = _with_unit_rows(a)
        known, smallest, most = self._known
        away = float(np.linalg.norm(a - known))  # no singular value changes by more
        if smallest - away >= enough * (most + away) and enough * (most - away) > RANK_TOLERANCE:
            return (smallest - away) / (most + away)
        smallest, most = (float(np.linalg.svd(x, compute_uv=False)[-1]) for x in (a[:, self.solved], a))
        self._known = a, smallest, most
        if smallest >= enough * most > RANK_TOLERANCE:  # no subset is better conditioned than all columns
            return smallest / most
        order = pivoted_qr(a, "economic")[2]
        best = float(np.linalg.svd(a[:, order[: len(a)]], compute_uv=False)[-1])
        return smallest / best if best > RANK_TOLERANCE else 0.0


def _good_rows(actual_rows: np.ndarray, ahead: np.ndarray, watch: Watch, below: float, between: bool) -> int:
    """Like `StateSelection.good_rows`, from the matrices (equations, n, columns) of one stage, actual and predicted."""
    c, predicted = (np.ascontiguousarray(x[:, :, watch.solved]) for x in (actual_rows, ahead))
    row, last, window = 0, ahead.shape[1], ROWS
    while row < last:
        try:
            inverse = np.linalg.inv(c[:, row])
        except np.linalg.LinAlgError:
            return row
        end = min(last, row + window)
        actual, expected = _changes(inverse, c[:, row + 1 : end + 1]), _changes(inverse, predicted[:, row:end])
        near = (actual <= PREDICTED_CHANGE) & (expected <= PREDICTED_CHANGE)
        count = end - row if near.all() else int(np.argmin(near))
        if not count:
            if between or not (actual[0] <= LARGEST_CHANGE and expected[0] <= PREDICTED_CHANGE):
                return row
            count = 1
        if watch.quality(actual_rows[:, row + count], below) < below:
            if between:
                return row
            rows = range(row + 1, row + count)
            return row + 1 + bisect_left(rows, True, key=lambda n: watch.quality(actual_rows[:, n], below) < below)
        row, window = row + count, 2 * count + 8
    return row


def _changes(inverse: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Return |inverse @ m - 1| for matrices (n, rows, n)."""
    size, rows = matrices.shape[:2]
    change = (inverse @ matrices.reshape(size, -1)).reshape(size, rows, size)
    change -= np.eye(size)[:, None, :]
    return np.sqrt(np.einsum("irj,irj->r", change, change))
