"""Claims about a function with a Newton block, decided over boxes: the Krawczyk operator proves that there is one
solution, Kantorovich's bound that Newton's method of the generated code reaches it.

From a start within e of the solution, a step of Newton's method leaves at most beta L e^2 / 2, beta a bound of |J^-1|
and L one of the second derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..cgen.newton_stages import stages
from ..cgen.newton_steps import CONTRACTION, REACH, STEPS
from ..cgen.real import DOUBLE as REAL
from ..compiler.causal import CausalFunction
from ..results.refusal import ArgumentError
from ..results.status import Status
from .claims import SOLVED, STATUS, Claim, of_margin
from .closed_form import FINITE, NONSINGULAR, SMALL, inputs_are_small
from .intervals import Array, Interval, add
from .regularity import along, least_singular_value, product
from .rounding import DOUBLE, GROWN
from .subdivision import SHORTEST, Decision, Leaves, common_faces
from .tape import IntervalTape, MeanValue
from .tube import KernelDerivatives, Surroundings, Tube

ONE = Claim(SOLVED, "exactly one solution in the region of the assembly mode")
REACHED = Claim(SOLVED, "Newton's method of the code reaches it from the answer of the last cycle")
SLACK = 1e-6  # of the tests of steps, far above the round-off of their bounds
# largest distance of an answer from the solution, in nominals, from which the next call may start
ANSWER = 1e-9
# CasADi rounds products of constants while it differentiates the residual
DERIVED = replace(DOUBLE, folded=8.0 * DOUBLE.unit)


class NewtonProver:
    """A Prover for a function with one Newton block. `away` (inputs,): how far the inputs move in one cycle; None: the
    claim REACHED is not made, and errors are bounded by the tolerance of the code, for answers within ANSWER."""

    def __init__(
        self, function: CausalFunction, bounds: Sequence[Claim], away: Array | None, regular: bool = False
    ) -> None:
        if len(function.kernels) != 1:
            raise ArgumentError(
                f"{function.name} has {len(function.kernels)} Newton blocks; certificates take one, so ask for less",
                "function",
            )
        cut = stages(function, f"certified_{function.name}", REAL)
        if cut.loops is not None:
            raise ArgumentError(f"the C code of {function.name} has loops, whose rounding is not bounded", "function")
        self.function, self.real, self.away, self.regular = function, REAL, away, regular
        (self._kernel,), (stage,) = function.kernels, cut.newton
        self.scale = np.asarray(self._kernel.scale, dtype=float)
        self.inputs, self.unknowns = sum(s.size for s in function.inputs), len(self.scale)
        self.targets = sum(s.size for s in function.outputs)
        self.limit, self.least = 1.0 / np.asarray(stage.largest), stage.least
        self._derivatives = KernelDerivatives(self._kernel)
        self._prepare, self._step = IntervalTape(stage.prepare), IntervalTape(stage.kernel)
        self._constants = stage.constants
        self._body = IntervalTape(cut.body)
        self._centred = MeanValue(self._body, range(self._body.outputs))
        before = [of_margin(m, k + self._constants, REAL) for k, m in enumerate(stage.margins)]
        after = [of_margin(m, k + self.targets, REAL) for k, m in enumerate(cut.margins)]
        self._before, self._after = before, [*after, *bounds]
        last = [*([] if away is None else [REACHED]), *([NONSINGULAR] if regular else [])]
        self.claims = [SMALL, ONE, *before, *self._after, FINITE, *last]

    @property
    def operations(self) -> set[int]:
        """The operations of the code, by CasADi's numbers."""
        return {s.op for tape in (self._prepare, self._step, self._body) for s in tape.steps}

    def decide(self, lo: Array, hi: Array, whole: Array) -> Decision:
        """Judge boxes."""
        n = lo.shape[1]
        away = np.zeros((self.inputs, 1)) if self.away is None else self.away[:, None]
        with np.errstate(all="ignore"):
            low, high = np.nextafter(lo - away, -np.inf), np.nextafter(hi + away, np.inf)
            tube = Tube(self._derivatives, self.scale, self.solutions(lo + 0.5 * (hi - lo)), low, high)
            start = np.full(n, ANSWER)
            if self.away is not None:
                start = (start + tube.around(np.zeros(n)).motion(self.away)) * GROWN
            reached, steps, e = self._newton(tube, start, low, high)
            states = [inputs_are_small(self.function.sizes, self._sizes, lo, hi, DOUBLE), tube.proved.astype(int)]
            prepared = self._prepare.over(low, high, DOUBLE)
            assert prepared.error is not None
            a, b = prepared.lo - GROWN * prepared.error, prepared.hi + GROWN * prepared.error
            states += [np.where(tube.proved, c.states(a[c.output], b[c.output]), 0) for c in self._before]
            least, most, error, singular = self._results(tube, e)
            states += [np.where(tube.proved, c.states(least[c.output], most[c.output]), 0) for c in self._after]
            t = slice(self.targets)
            finite = np.isfinite(least[t]).all(axis=0) & np.isfinite(most[t]).all(axis=0)
            states.append((tube.proved & finite).astype(int))
            if self.away is not None:
                states.append(reached.astype(int))
            if self.regular:
                states.append((tube.proved & (singular > 0)).astype(int))
            share = (hi - lo) / np.where(whole > 0, whole, 1.0)[:, None]
            side = np.where(share.max(axis=0) > SHORTEST, np.argmax(share, axis=0), -1)
        line = [tube.middle, tube.centre, tube.tangents.lo.reshape(-1, n), tube.unique]
        last = [np.where(reached, steps, 0)[None], -np.nan_to_num(singular)[None]]
        return Decision(np.array(states), side, np.vstack([error[t], most[t], -least[t], *line, *last]))

    def settled(self, lo: Array, hi: Array, states: Array, worst: Array) -> Array:
        """Return the states of boxes, undecided where boxes with a common face may hold different solutions: code that
        follows one solution across the face would not meet the other."""
        good = np.flatnonzero((states > 0).all(axis=0))
        pairs, points = common_faces(lo[:, good], hi[:, good])
        if not pairs.shape[1]:
            return states
        a, b = good[pairs]
        first, m, k = 3 * self.targets, self.unknowns, self.inputs
        sizes = np.cumsum([k, m, m * k])
        middle, centre, tangents, unique = np.split(worst[first : first + k + m * (2 + k)], sizes)
        tangents = tangents.reshape(m, k, -1)

        def line(of: Array) -> Array:
            return centre[:, of] + ((points - middle[:, of])[None] * tangents[:, :, of]).sum(axis=1)

        same = np.zeros(len(a), dtype=bool)
        with np.errstate(all="ignore"):
            z = line(a)
            for _ in range(3):
                r, J = self._derivatives.at(z, points)
                regular = np.isfinite(J.lo).all(axis=(1, 2)) & np.isfinite(r.lo).all(axis=(1, 2))
                step = np.zeros_like(z)
                step[:, regular] = (np.linalg.pinv(J.lo[regular][:, :, :m]) @ r.lo[regular])[:, :, 0].T
                z = z - step
            tube = Tube(self._derivatives, self.scale, z, points, points)
            far = [np.abs(z - line(of)) * GROWN + tube.w + 1e-13 * self.scale[:, None] for of in (a, b)]
            same = tube.proved & (far[0] < unique[:, a]).all(axis=0) & (far[1] < unique[:, b]).all(axis=0)
        result = states.copy()
        result[1, np.concatenate([a[~same], b[~same]])] = 0  # the claim ONE
        return result

    @property
    def _sizes(self) -> list[int]:
        return [s.size for s in self.function.inputs]

    def solutions(self, a: Array) -> Array:
        """Return the solutions (unknowns, n) of the declared assembly mode at points, by the function itself; NaN
        without one. Only centres of regions: what holds around them is proved."""
        first = np.cumsum(self._sizes)[:-1]
        arguments = [c.T if s.shape else c[0] for s, c in zip(self.function.inputs, np.split(a, first), strict=True)]
        zs, status = self.function.unknowns(*arguments)
        return np.where(status == 0, zs[0].T, np.nan)

    def _newton(self, tube: Tube, start: Array, low: Array, high: Array) -> tuple[Array, Array, Array]:
        """Return whether Newton's method reaches the solution from a distance `start`, in nominals, after how many
        steps only round-off is left, and bounds of the distance of the answer from the solution, in nominals."""
        near = tube.around(start)
        beta, pivots = near.inverse_bounds()
        noise, perturbed = self._rounding(near, low, high)
        spoilt = beta * perturbed * self.scale.max() * GROWN
        half = 0.5 * near.bend()
        quiet = beta * noise * 2.0 + 4.0 * DOUBLE.unit * near.largest()
        e, steps = start.copy(), np.zeros(len(start))
        for k in range(STEPS):
            e = (half * e * e + 2.0 * spoilt * e + quiet) * GROWN
            steps = np.where((e > 3.0 * quiet) & (steps == k), k + 1, steps)
        rest = near.row_sums() * e * GROWN + noise
        left = (half * start + 2.0 * spoilt) * GROWN
        good = _shrinking(left, quiet) & (start * (1.0 + left) + quiet <= REACH * (1.0 - SLACK))
        good &= (e <= ANSWER) & (rest <= self.limit.min())
        good &= tube.proved & (pivots > self.least * (1.0 + 2.0**-20) + perturbed)
        if self.away is None:
            tolerance = beta * (self.limit.max() + noise) * GROWN
            e = np.where(tolerance <= ANSWER, tolerance, np.nan)
        return good, np.minimum(steps + 1, STEPS), e

    def _rounding(self, near: Surroundings, low: Array, high: Array) -> tuple[Array, Array]:
        """Return bounds of the round-off of residuals, and of the perturbation of the Jacobian, as a row sum, that
        stands for its round-off and that of the elimination."""
        # round-off of a residual: its constants first, then the steps of the kernel
        prepared = self._prepare.over(low, high, DOUBLE)
        assert prepared.error is not None
        z, c, m = near.z, slice(self._constants), self.unknowns
        lo, hi = np.vstack([z.lo, prepared.lo[c]]), np.vstack([z.hi, prepared.hi[c]])
        given = np.vstack([0.0 * z.lo, prepared.error[c]])
        kernel, derived = (self._step.over(lo, hi, arithmetic, given=given) for arithmetic in (DOUBLE, DERIVED))
        assert kernel.error is not None and derived.error is not None
        size = np.maximum(np.abs(kernel.lo[m:]), np.abs(kernel.hi[m:])).max(axis=0)
        # LU with partial pivoting: backward error of 3 n u |L| |U|, doubled for the inverse of
        # the pivot, with growth up to 2^(n - 1); and round-off of J
        elimination = 6.0 * m**3 * DOUBLE.unit * 2.0 ** (m - 1) * size
        return kernel.error[:m].max(axis=0), derived.error[m:].max(axis=0) * m + elimination

    def _results(self, tube: Tube, e: Array) -> tuple[Array, Array, Array, Array]:
        """Return enclosures of the computed targets and margins, (outputs, n) each, bounds of their errors, and lower
        bounds (n,) of the smallest singular value of the Jacobian of the targets by the inputs, NaN if unknown."""
        z, k = tube.z, self.inputs
        lo, hi = np.vstack([tube.lo, z.lo]), np.vstack([tube.hi, z.hi])
        natural = self._body.over(lo, hi, DOUBLE, given=np.vstack([0.0 * tube.lo, e * self.scale[:, None]]))
        at_point = np.vstack([tube.middle, tube.centre])
        at = self._body.over(at_point, at_point)
        slopes = self._centred.slopes(lo, hi)
        by_a, by_z = (Interval(slopes.lo[:, s], slopes.hi[:, s]) for s in (slice(k), slice(k, None)))
        # slopes by the inputs and through the tangent are added before they meet the way
        along_tube = add(by_a, _times(by_z, tube.tangents))
        total = add(add(Interval(at.lo, at.hi), along(along_tube, tube.way)), along(by_z, Interval(-tube.w, tube.w)))
        usable = natural.continuous & ~np.isnan(total.lo)
        least = np.where(usable, np.maximum(natural.lo, total.lo), natural.lo)
        most = np.where(usable, np.minimum(natural.hi, total.hi), natural.hi)
        assert natural.error is not None
        error = GROWN * natural.error
        singular = np.full(z.lo.shape[1], np.nan)
        if self.regular:
            by_input = add(by_a, _times(by_z, tube.around(np.zeros_like(singular)).derivative()))
            matrices = Interval(*(x[: self.targets].transpose(2, 0, 1) for x in by_input))
            smooth = natural.decided & self._centred.slope.over(lo, hi).decided
            singular = np.where(smooth, least_singular_value(matrices), np.nan)
        return np.nextafter(least - error, -np.inf), np.nextafter(most + error, np.inf), natural.error, singular

    def bounds(self, leaves: Leaves, good: Array, wide: Array) -> tuple[Array, Array, Array, Array]:
        """Return greatest errors in double, none in float, greatest and negative least values of the targets over the
        chosen boxes."""
        t = self.targets
        errors, most, least = leaves.worst[: 3 * t, good].max(axis=1).reshape(3, t)
        return errors, np.full(t, np.nan), most, least

    def at(self, points: Array) -> Array:
        """Judge points by a call of the function."""
        first = np.cumsum(self._sizes)[:-1]
        arguments = [
            c.T if s.shape else c[0] for s, c in zip(self.function.inputs, np.split(points, first), strict=True)
        ]
        *values, status = self.function(*arguments)
        rows = np.vstack([np.asarray(v).reshape(points.shape[1], -1).T for v in values])
        states = np.zeros((len(self.claims), points.shape[1]), dtype=int)
        for k, claim in enumerate(self.claims):
            if claim.kind == STATUS and claim is FINITE:
                # Newton's method may fail where there is a solution
                states[k] = np.where(status == 0, 1, np.where(status == Status.NOT_CONVERGED, 0, -1))
            elif claim.output >= 0 and claim.output < self.targets and claim.kind != STATUS:
                states[k] = np.where(status == 0, claim.states(rows[claim.output], rows[claim.output]), 0)
        return states


def _shrinking(left: Array, quiet: Array) -> Array:
    """Return whether steps that leave at most `left` of the distance e, and `quiet` of round-off, pass the code's test:
    each at most CONTRACTION of the one before, or below REAL.round_off.

    A step has at least (1 - left) e - 2 quiet, the next one at most (1 + left) e' + 2 quiet, e' = left e + quiet. The
    next one is tested only above the limit of the round-off, which bounds e from below.
    """
    following = (REAL.round_off - 2.0 * quiet) / (1.0 + left) - quiet  # left e, at least
    t = quiet * left / following  # quiet / e, at most
    largest, smallest = (1.0 + left) * (left + t) + 2.0 * t, 1.0 - left - 2.0 * t
    return (following > 0.0) & (smallest > 0.0) & (largest <= CONTRACTION * smallest * (1.0 - SLACK))


def _times(a: Interval, b: Interval) -> Interval:
    """Return matrices (m, k, n) times (k, j, n) -> (m, j, n)."""
    rows = product(*(Interval(x.lo.transpose(2, 0, 1), x.hi.transpose(2, 0, 1)) for x in (a, b)))
    return Interval(rows.lo.transpose(1, 2, 0), rows.hi.transpose(1, 2, 0))
