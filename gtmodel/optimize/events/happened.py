"""Check that exactly the prescribed events happen along a solution, also between its points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...compiler.analysis.switching import differentiated, names_of
from ..formulation.system import on_rows
from ..linking import Joined, continuing
from ..nlp import Nlp, placed
from ..solution import constants, horizon, states_and_controls
from .sequence import watched
from .thresholds import Waits

if TYPE_CHECKING:
    from .phases_of_events import EventPhases

# samples in each element, including both ends
LOOKS = 17
# relative to a quantity's largest value: closer to its threshold its side is below the solver's tolerance
TOUCHES = 1e-6
# in nominals: a state of one mode that the next mode computes has jumped if it changes by more
JUMPED = 1e-6


def doubts_about(model: EventPhases, joined: Joined, x: np.ndarray) -> list[str]:
    """Return a sentence for each event that happens unexpectedly, and for each expected one that does not."""
    thresholds = model.order.thresholds
    moving = [t for t in range(len(thresholds.first)) if not thresholds.discrete(t)]
    samples: list[tuple[np.ndarray, np.ndarray]] = []
    for k, nlp in enumerate(joined.nlps.values()):
        expressions = [model.in_modes(thresholds.expressions[t], model.pieces[k]) for t in moving]
        samples.append(_along(nlp, x[joined.at[k] : joined.at[k + 1]], expressions))
    sizes = np.max([np.max(np.abs(values), axis=1, initial=0.0) for _, values in samples], axis=0, initial=0.0)
    signs = []
    for _, values in samples:
        with np.errstate(invalid="ignore"):
            signs.append(np.where(np.abs(values) <= TOUCHES * sizes[:, None], 0, np.sign(values)).astype(int))
    check = _Check(model, moving, [times for times, _ in samples], signs)
    remarks = [s for k in range(len(signs)) for s in (*check.within(k), *check.at_end(k))]
    return [*dict.fromkeys([*remarks, *_jumps(model, joined, x)])]


def _along(nlp: Nlp, x: np.ndarray, expressions: Sequence[ca.SX]) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,) and values (expressions, n) by the model's equations, also between collocation points."""
    problem, mesh = nlp.problem, placed(nlp, x)
    s = np.unique(mesh.edges[:-1, None] + mesh.h[:, None] * np.linspace(0.0, 1.0, LOOKS))
    s = np.append(s[(s > 0.0) & (s < 1.0)], 1.0)
    s = np.append(0.0, s)
    xs, rates, us, times = states_and_controls(nlp, x, s)
    if not expressions:
        return times, np.zeros((0, len(times)))
    f = ca.Function("looks", problem.arguments, [ca.densify(ca.vertcat(*_expressed(nlp, expressions)))])
    (values,) = on_rows(f, (xs, rates, us), constants(nlp, x), times)
    return times, values


def _expressed(nlp: Nlp, expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Express the model in the quantities of a phase at any instant."""
    builder = nlp.problem.builder
    at_points = builder.express(list(expressions))
    between = builder.off_points(list(expressions), at_points)
    return [e if o is None else o for e, o in zip(at_points, between, strict=True)]


class _Check:
    """Compares the sides of the continuous thresholds along each phase with the assumed ones."""

    def __init__(
        self, model: EventPhases, moving: Sequence[int], times: list[np.ndarray], signs: list[np.ndarray]
    ) -> None:
        self._model, self._moving, self._times, self._signs = model, list(moving), times, signs
        self._pieces = model.pieces

    def within(self, k: int) -> list[str]:
        """Return remarks on events inside phase k."""
        remarks = []
        for row, t in enumerate(self._moving):
            remarks += self._threshold(k, t, self._signs[k][row])
        return remarks

    def _threshold(self, k: int, t: int, signs: np.ndarray) -> list[str]:
        piece, times = self._pieces[k], self._times[k]
        events = watched(t, piece.waits, piece.mode_waits)
        if not events and t not in piece.ends:
            return []
        off_threshold = np.flatnonzero(signs)
        if not off_threshold.size:
            return [f"{self._names(k, t)} stays at its threshold throughout phase {k + 1}, so its side is undetermined"]
        first, last = int(off_threshold[0]), int(off_threshold[-1])
        remarks = []
        if t in piece.kept and signs[first] != piece.kept[t]:
            remarks.append(f"{self._names(k, t)} is on the wrong side at the start of phase {k + 1}")
        for a, b in pairwise(off_threshold):
            if signs[b] != signs[a] and signs[b] in events:
                remarks.append(f"{self._names(k, t, int(signs[b]))} also happens at {times[b]:.6g} s")
            elif b > a + 1 and signs[b] == signs[a] and -signs[a] in events:
                remarks.append(self._touches(k, t, -int(signs[a]), float(times[a + 1])))
        if t in piece.ends and signs[last] == piece.ends[t]:
            remarks.append(f"{self._names(k, t)} already holds before {times[-1]:.6g} s, so no event happens there")
        at_end = t in piece.ends or k == len(self._pieces) - 1
        if last < len(signs) - 1 and not at_end and -signs[last] in events:
            remarks.append(self._touches(k, t, -int(signs[last]), float(times[last + 1])))
        at_start = k == 0 or t in self._pieces[k - 1].ends
        if first > 0 and not at_start and -signs[first] in events:
            remarks.append(self._touches(k, t, -int(signs[first]), float(times[0])))
        return remarks

    def _touches(self, k: int, t: int, side: int, time: float) -> str:
        return (
            f"{self._names(k, t, side)} is touched at {time:.6g} s, where the order has no event: the optimum lies on "
            "the boundary of this order, and another order may be better"
        )

    def at_end(self, k: int) -> list[str]:
        """Return remarks on events that immediately follow the one at the end of phase k."""
        if k == len(self._pieces) - 1:
            return []
        piece, after = self._pieces[k], self._pieces[k + 1]
        sides_before = {t: -piece.ends[t] if t in piece.ends else self._side(k, t, -1) for t in self._moving}
        sides_after = {t: self._side(k + 1, t, 0) for t in self._moving}
        remarks = []
        for n, when in enumerate(self._model.order.events.whens):
            old, new = piece.waits[n], after.waits[n]
            held_before = old if isinstance(old, bool) else sides_before[old.threshold] == old.side
            holds_after = new if isinstance(new, bool) else sides_after[new.threshold] == new.side
            if holds_after and not held_before and n not in piece.acted():
                remarks.append(f"{when.name} ({when.where}) follows immediately at {self._times[k][-1]:.6g} s")
        return remarks

    def _side(self, k: int, t: int, which: int) -> int:
        """Return the first or last side in a phase; 0 if the quantity stays at the threshold."""
        signs = self._signs[k][self._moving.index(t)]
        off_threshold = signs[signs != 0]
        return int(off_threshold[which]) if off_threshold.size else 0

    def _names(self, k: int, t: int, side: int | None = None) -> str:
        """Return the names of events that wait for a side of a threshold in phase k."""
        piece, order = self._pieces[k], self._model.order
        names = []
        for name, event in order.named.items():
            condition = piece.waits[event.when] if event.when is not None else piece.mode_waits[event.mode or 0]
            if not isinstance(condition, Waits) or condition.threshold != t:
                continue
            if side is None or event.when is None or condition.side == side:
                names.append(f"'{name}' ({event.where})")
        return " and ".join(names) or f"the threshold of {order.thresholds.text(t)}"


def _jumps(model: EventPhases, joined: Joined, x: np.ndarray) -> list[str]:
    """Return remarks on states that jump between modes without a gt.reinit."""
    remarks = []
    nlps = list(joined.nlps.values())
    for k, (old, new) in enumerate(pairwise(nlps)):
        flat, jump = model.order.flat, model.pieces[k].jump
        restarted = set(jump.restarted) if jump else set()
        before_it, alias = old.problem.base.alias, new.problem.base.alias
        resolved = {alias.resolve(*p)[1:] for p in restarted}
        # the old state that each new state continues
        linked = {state: before_it.resolve(*name)[1:] for state, name in continuing(old, new).items()}
        names = names_of(differentiated(old.problem.flat), before_it)
        pairs = [
            name
            for state in old.problem.state_pairs
            for name in names.get(state, [state])
            if (new_state := alias.resolve(*name)[1:]) not in resolved and linked.get(new_state) != state
        ]
        if not pairs:
            continue
        symbols = [flat.scope.symbol(*p) for p in pairs]
        before = _along(old, x[joined.at[k] : joined.at[k + 1]], symbols)[1][:, -1]
        after = _along(new, x[joined.at[k + 1] : joined.at[k + 2]], symbols)[1][:, 0]
        end = horizon(old, x[joined.at[k] : joined.at[k + 1]])[1]
        for pair, a, b in zip(pairs, before, after, strict=True):
            below = pair[1] > 0 and any(order > 0 for _, order in restarted)
            if abs(b - a) > JUMPED * max(flat.variables[pair[0]].nominal, abs(a)) and not below:
                name = flat.symbol_name(*pair)
                remarks.append(f"'{name}' jumps from {a:.6g} to {b:.6g} at {end:.6g} s without a gt.reinit")
    return remarks
