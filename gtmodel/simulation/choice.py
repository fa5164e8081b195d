"""Which variables are the states: chosen at a point, and watched along the motion.

Each stage of the structural analysis solves for as many columns of the system Jacobian as it has rows; the other
columns are states. A choice goes bad where the solved columns C become singular although others would not.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiler.matrices import pivoted_qr
from ..compiler.plan import CausalPlan
from ..compiler.states import Stage, choose, stage_choices
from ..lang.source import ModelError

# below this fraction of the best conditioning the states are chosen anew
SWITCH_BELOW = 0.3
# |C^-1 dC| up to which a prediction may go: C stays invertible, and a root keeps its sign
PREDICTED_CHANGE = 0.4
# and beyond which a motion has gone too far in one step: the prediction was too short-sighted
LARGEST_CHANGE = 0.8
# relative column norm below which nothing is left to choose, as in compiler.states
RANK_TOLERANCE = 1e-8

# the solved columns of each stage that had a choice
Choice = tuple[tuple[int, ...], ...]


def choice_of(stages: list[Stage]) -> Choice:
    return tuple(tuple(sorted(s.matched.values())) for s in stage_choices(stages))


@dataclass(eq=False)
class Reference:
    """Solved columns at one instant: their quality (1: as good as any choice), inverses and row scales."""

    quality: float
    inverses: list[np.ndarray]
    scales: list[np.ndarray]
    matrices: list[np.ndarray]


class StateSelection:
    """The system Jacobian of a model at any point over `plan.pairs`; knows how good a choice of states is."""

    def __init__(self, plan: CausalPlan, prefer: frozenset[int]) -> None:
        self._plan, self._prefer = plan, prefer
        flat, structure = plan.flat, plan.structure
        system = ca.densify(plan.system)
        self._system = ca.Function("system", [plan.sampler.w, flat.scope.time], [system])
        self._pattern = set(zip(*plan.system.sparsity().get_triplet(), strict=True))
        self._stages = stage_choices(plan.stages)
        self._nominal = np.array([flat.variables[i].nominal for i in structure.unknowns])
        place = {pair: n for n, pair in enumerate(plan.pairs)}
        # position of each symbol's first and second derivative; the last entry of an extended point is zero
        self._next = [[place.get((i, k + m), -1) for i, k in plan.pairs] for m in (1, 2)]

    @property
    def has_choice(self) -> bool:
        return bool(self._stages)

    def matrix(self, w: np.ndarray, time: float) -> np.ndarray:
        return np.asarray(self._system(w, time).full())

    # -- choosing ----------------------------------------------------------------------------------

    def choose(self, w: np.ndarray, time: float) -> Choice | None:
        """Solved columns at a point: those that leave the preferred states where they are good enough, else the best
        conditioned ones. None where no choice would do."""
        m = self.matrix(w, time)
        if not np.all(np.isfinite(m)):
            return None
        plan = self._plan
        try:
            preferred = choice_of(choose(plan.flat, plan.structure, [m], self._prefer, self._pattern))
        except ModelError:
            return None
        if self.refer(preferred, m).quality >= SWITCH_BELOW:
            return preferred
        best = self._best(m)
        return best if best is not None and self.refer(best, m).quality > 0.0 else preferred

    def states(self, choice: Choice) -> list[int]:
        """Variables, by index, of the columns that a choice leaves unsolved."""
        columns = {j for s, solved in zip(self._stages, choice, strict=True) for j in s.columns if j not in solved}
        return sorted(self._plan.structure.unknowns[j] for j in columns)

    def _best(self, m: np.ndarray) -> Choice | None:
        """Best conditioned columns, stage by stage; what one stage solved stays solved in the next."""
        choice: list[tuple[int, ...]] = []
        solved: list[int] = []
        for stage in self._stages:
            a = self._scaled(m, stage)[1]
            place = {j: n for n, j in enumerate(stage.columns)}
            first = [place[j] for j in solved if j in place]
            q = np.linalg.qr(a[:, first])[0] if first else np.zeros((len(stage.rows), 0))
            rest = [n for n in range(len(stage.columns)) if n not in set(first)]
            left = a[:, rest] - q @ (q.T @ a[:, rest])
            _, r, order = pivoted_qr(left, "economic")
            count = len(stage.rows) - len(first)
            if count and np.abs(r[count - 1, count - 1]) <= RANK_TOLERANCE * np.abs(r[0, 0]):
                return None
            solved = sorted(stage.columns[n] for n in [*first, *(rest[k] for k in order[:count])])
            choice.append(tuple(solved))
        return tuple(choice)

    # -- watching ----------------------------------------------------------------------------------

    def refer(self, choice: Choice, m: np.ndarray) -> Reference:
        """How good a choice is where the system Jacobian is m."""
        reference = Reference(1.0 if np.all(np.isfinite(m)) else 0.0, [], [], [])
        for stage, solved in zip(self._stages, choice, strict=True) if reference.quality else ():
            scale, a = self._scaled(m, stage)
            place = {j: n for n, j in enumerate(stage.columns)}
            c = a[:, [place[j] for j in solved]]
            _, _, order = pivoted_qr(a, "economic")
            smallest, best = (np.linalg.svd(x, compute_uv=False)[-1] for x in (c, a[:, order[: len(stage.rows)]]))
            quality = float(smallest / best) if best > RANK_TOLERANCE else 0.0
            reference.quality = min(reference.quality, quality)
            if not quality > 0.0:
                break
            reference.inverses.append(np.linalg.inv(c))
            reference.scales.append(scale)
            reference.matrices.append(c)
        return reference

    def changes(self, choice: Choice, reference: Reference, points: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Largest |C^-1 dC| between the reference and each of other points; below 1 no singular pose lies between."""
        matrices = np.asarray(self._system(points.T, times[None, :]).full())
        matrices = matrices.reshape(matrices.shape[0], len(times), -1).transpose(1, 0, 2)
        worst = np.zeros(len(times))
        for n, (stage, solved) in enumerate(zip(self._stages, choice, strict=True)):
            c = matrices[:, stage.rows][:, :, solved] * self._nominal[list(solved)] / reference.scales[n]
            change = reference.inverses[n] @ (c - reference.matrices[n])
            worst = np.maximum(worst, np.linalg.norm(change, axis=(1, 2)))
        return np.where(np.isfinite(worst), worst, np.inf)

    def horizon(self, choice: Choice, reference: Reference, w: np.ndarray, time: float, longest: float) -> float:
        """Time [s], at most `longest`, in which the solved columns stay good if the motion goes on as it is."""
        rate, curve = (np.append(w, 0.0)[index] for index in self._next)
        span = longest
        while span > 1e-12 * longest:
            ahead = w + span * rate + span**2 / 2 * curve
            if self.changes(choice, reference, ahead[None, :], np.array([time + span]))[0] <= PREDICTED_CHANGE:
                return span
            span /= 2
        return span

    def _scaled(self, m: np.ndarray, stage: Stage) -> tuple[np.ndarray, np.ndarray]:
        """Row scales and the stage's matrix in nominals with rows scaled to maximum 1."""
        a = m[np.ix_(stage.rows, stage.columns)] * self._nominal[stage.columns]
        size = np.max(np.abs(a), axis=1, keepdims=True)
        scale = np.where(size > 0, size, 1.0)
        return scale, a / scale
