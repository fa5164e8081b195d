"""Claims about a closed form, decided over boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..cgen.newton_steps import run
from ..cgen.real import DOUBLE as REAL_DOUBLE, Real
from ..compiler.analysis.sizes import Sizes
from ..compiler.causal import CausalFunction
from ..compiler.rows import map_columns
from .claims import REGULAR, STATUS, Claim, status_claims
from .intervals import JUMPS, Array, Interval
from .regularity import least_singular_value
from .rounding import ARITHMETICS, GROWN, Arithmetic
from .subdivision import SHORTEST, Decision, Leaves, sharpened
from .tape import IntervalTape, MeanValue, with_jacobian

SHARPENING = 2000  # boxes spent on sharper bounds of errors and values
FINITE = Claim(STATUS, "finite results")
SMALL = Claim(STATUS, "inputs of a size at which round-off stays small")
NONSINGULAR = Claim(REGULAR, "a Jacobian of full rank, outputs by inputs")


class ClosedFormProver:
    """A Prover for a closed form: its status in the arithmetic `real`, bounds of outputs and, with `regular`, a regular
    Jacobian. Without `centred`, natural evaluation alone decides. The operations are those of
    `function.closed`, from which the C code is written."""

    def __init__(
        self,
        function: CausalFunction,
        bounds: Sequence[Claim],
        regular: bool = False,
        real: Real = REAL_DOUBLE,
        centred: bool = True,
    ) -> None:
        self.function, self.real, self.regular, self._uses_centred = function, real, regular, centred
        self.arithmetic: Arithmetic = ARITHMETICS[real.name]
        self.sizes: Sizes = function.sizes_in(real.precision)
        self.tape = IntervalTape(function.closed)
        self.rows = [*status_claims(function, real), *bounds]  # claims about one output each
        self.claims = [SMALL, *self.rows, FINITE, *([NONSINGULAR] if regular else [])]
        self.targets = sum(s.size for s in function.outputs)
        self._used = sorted({c.output for c in self.rows})
        self._centred = MeanValue(self.tape, self._used)
        self._jacobian = with_jacobian(self.tape, range(self.targets))[1] if regular else None
        # inputs along which a box is cut until the Jacobian is regular
        jumps = [self.tape.depending(k) for k, s in enumerate(self.tape.steps) if s.op in JUMPS]
        self._bent = np.logical_or.reduce([*jumps, self._jacobian.varying]) if self._jacobian else np.zeros(0, bool)
        self._curved = None if self._jacobian is None else MeanValue(self._jacobian, range(self._jacobian.outputs))

    @property
    def operations(self) -> set[int]:
        """The operations of the code, by CasADi's numbers."""
        return {s.op for s in self.tape.steps}

    def decide(self, lo: Array, hi: Array, whole: Array) -> Decision:
        """Judge boxes; what natural interval evaluation leaves open is tried with the mean-value form."""
        n = lo.shape[1]
        share = (hi - lo) / np.where(whole > 0, whole, 1.0)[:, None]
        states, undefined = self._natural(lo, hi, None)
        slopes = np.full((len(self._used), len(lo), n), np.nan)
        rest = np.flatnonzero(~(states > 0).all(axis=0))
        if rest.size and self._used and self._uses_centred:
            known, slope = self._known(lo[:, rest], hi[:, rest])
            slopes[:, :, rest] = slope.magnitude
            states[:, rest], undefined[rest] = self._natural(lo[:, rest], hi[:, rest], known)
        worst = np.zeros((0, n))
        if self._jacobian is not None:
            least = self._regular(lo, hi)
            states = np.vstack([states, (least > 0).astype(int)])
            worst = -np.where(np.isnan(least), 0.0, least)[None]
        return Decision(states, self._sides(states, slopes, undefined, share), worst)

    def settled(self, lo: Array, hi: Array, states: Array, worst: Array) -> Array:
        """Return the states as they are: a closed form has one value at each point."""
        return states

    def _known(self, lo: Array, hi: Array) -> tuple[dict[int, Interval], Interval]:
        """Return mean-value enclosures of the claimed outputs, infinite where there are none, and the slopes."""
        values, slopes = self._centred.over(lo, hi)
        jump = ~self.tape.over(lo, hi).continuous
        low, high = (np.where(np.isnan(x) | jump, far, x) for x, far in ((values.lo, -np.inf), (values.hi, np.inf)))
        return {output: Interval(low[k], high[k]) for k, output in enumerate(self._used)}, slopes

    def _natural(self, lo: Array, hi: Array, known: dict[int, Interval] | None) -> tuple[Array, Array]:
        """Return the states of all claims but NONSINGULAR, and the first undefined step."""
        e = self.tape.over(lo, hi, self.arithmetic, known)
        assert e.error is not None
        least, most = e.lo - GROWN * e.error, e.hi + GROWN * e.error
        with np.errstate(invalid="ignore"):
            least, most = np.nextafter(least, -np.inf), np.nextafter(most, np.inf)
        rows = [c.states(least[c.output], most[c.output]) for c in self.rows]
        finite = np.isfinite(least[: self.targets]).all(axis=0) & np.isfinite(most[: self.targets]).all(axis=0)
        return np.array(
            [inputs_are_small(self.sizes, self._inputs, lo, hi, self.arithmetic), *rows, finite.astype(int)]
        ), e.undefined

    @property
    def _inputs(self) -> list[int]:
        return [s.size for s in self.function.inputs]

    def _regular(self, lo: Array, hi: Array) -> Array:
        """Return lower bounds (n,) of the smallest singular value; NaN where a singular pose cannot be excluded, or
        where there may be no Jacobian: at a jump or a corner, also one on a face, so the boxes are made wider."""
        assert self._jacobian is not None and self._curved is not None
        lo, hi = np.nextafter(lo, -np.inf), np.nextafter(hi, np.inf)
        e = self._jacobian.over(lo, hi)
        smooth = e.decided & self.tape.over(lo, hi).decided
        least = np.where(smooth, least_singular_value(self._matrices(e.lo, e.hi)), np.nan)
        rest = np.flatnonzero(~np.isnan(e.lo).any(axis=0) & e.continuous & smooth)
        if rest.size:
            at, slopes, way = self._curved.parts(lo[:, rest], hi[:, rest])
            shape = (self.tape.inputs, self.targets, self.tape.inputs, -1)
            second = Interval(*(x.reshape(shape).transpose(3, 1, 0, 2) for x in slopes))
            sharper = least_singular_value(self._matrices(at.lo, at.hi), second, way)
            least[rest] = np.fmax(least[rest], sharper)
        return least

    def _matrices(self, lo: Array, hi: Array) -> Interval:
        """Return entries (targets * inputs, n), column after column, as matrices (n, targets, inputs)."""
        shape = (self.tape.inputs, self.targets, -1)
        return Interval(*(x.reshape(shape).transpose(2, 1, 0) for x in (lo, hi)))

    def continuous(self, lo: Array, hi: Array) -> bool:
        """Return whether neither the outputs nor their Jacobian jump in any box."""
        tapes = [t for t in (self.tape, self._jacobian) if t is not None]
        return all(bool(t.over(lo, hi).continuous.all()) for t in tapes)

    def sign(self, points: Array) -> Array:
        """Return the sign of the determinant of a square Jacobian at points, 0 if it is not certain."""
        assert self._jacobian is not None
        e = self._jacobian.over(points, points)
        matrices = self._matrices(e.lo, e.hi)
        if self.targets != self.tape.inputs:
            return np.zeros(points.shape[1])
        good = least_singular_value(matrices) > 0
        return np.where(good, np.sign(np.linalg.det(np.where(good[:, None, None], matrices.lo, 0.0))), 0.0)

    def _sides(self, states: Array, slopes: Array, undefined: Array, width: Array) -> Array:
        """Return the side to halve: the one along which the open claims vary most."""
        k, n = width.shape
        score = np.zeros((k, n))
        place = {output: i for i, output in enumerate(self._used)}
        for c, claim in enumerate(self.rows, 1):
            open_ = states[c] == 0
            if not open_.any():
                continue
            change = slopes[place[claim.output]] * width
            total = change.sum(axis=0)
            depends = (
                self.tape.depending(self.tape.sources[claim.output])[:, None] * width
                if claim.output in self.tape.sources
                else 0.0 * width
            )
            known = np.isfinite(total) & (total > 0)
            share = np.where(
                known, change / np.where(known, total, 1.0), depends / np.maximum(depends.sum(axis=0), 1e-300)
            )
            score = np.where(open_, np.maximum(score, share), score)
        # then steps that may be undefined, then the Jacobian
        for step in np.unique(undefined[(score.max(axis=0) == 0) & (undefined >= 0)]):
            here = (undefined == step) & (score.max(axis=0) == 0)
            score[:, here] = self.tape.depending(int(step))[:, None] * width[:, here]
        if self._jacobian is not None:
            here = (score.max(axis=0) == 0) & (states[-1] == 0)
            score[:, here] = self._bent[:, None] * width[:, here]
        side = np.argmax(score, axis=0)
        chosen = np.take_along_axis(width, side[None], axis=0)[0]
        return np.where((score.max(axis=0) > 0) & (chosen > SHORTEST), side, -1)

    def at(self, points: Array) -> Array:
        """Judge points by evaluation in the arithmetic itself."""
        columns = np.split(points, np.cumsum(self._inputs)[:-1])
        if self.real is REAL_DOUBLE:
            results = map_columns(self.function.closed, columns)
        else:
            results = run(self.function.closed, [self.real.array(c) for c in columns])
        values = np.vstack(results).astype(float)
        rows = [
            np.where(np.isnan(values[c.output]), -1, c.states(values[c.output], values[c.output])) for c in self.rows
        ]
        finite = np.where(np.isfinite(values[: self.targets]).all(axis=0), 1, -1)
        with np.errstate(over="ignore"):
            small = np.where(self.sizes.within([self.real.array(c) for c in columns]), 1, -1)
        states = np.array([small, *rows, finite])
        # a point that is no number of the code stands for another one, perhaps outside of the box
        states = np.where((self.real.array(points) == points).all(axis=0), states, np.maximum(states, 0))
        return states if self._jacobian is None else np.vstack([states, np.zeros((1, points.shape[1]), dtype=int)])

    def bounds(self, leaves: Leaves, good: Array, wide: Array) -> tuple[Array, Array, Array, Array]:
        """Return greatest errors in double and in float, greatest and negative least values of the targets over the
        chosen boxes, made sharper by halving these along the `wide` sides."""
        lo, hi = leaves.lo[:, good], leaves.hi[:, good]
        double, single, most, least = sharpened(self.measures, lo, hi, np.flatnonzero(wide), SHARPENING).reshape(4, -1)
        return double, single, most, least

    def measures(self, lo: Array, hi: Array) -> Array:
        """Return (4 targets, n): bounds of the errors in double and in float, and of the values, greatest and negative
        least."""
        known = self._known(lo, hi)[0] if self._uses_centred else None
        double, single = (self.tape.over(lo, hi, a, known) for a in ARITHMETICS.values())
        assert double.error is not None and single.error is not None
        t = slice(self.targets)
        return np.vstack([double.error[t], single.error[t], double.hi[t], -double.lo[t]])


def inputs_are_small(sizes: Sizes, inputs: Sequence[int], lo: Array, hi: Array, arithmetic: Arithmetic) -> Array:
    """Return 1 where all inputs of a box, `inputs` numbers in each argument, are within the limits of their sizes."""
    largest = np.maximum(np.abs(lo), np.abs(hi))
    with np.errstate(over="ignore"):
        total, first = np.zeros(lo.shape[1]), 0
        for count, limit in zip(inputs, sizes.limits, strict=True):
            total += sizes.most / limit**2 * (largest[first : first + count] ** 2).sum(axis=0)
            first += count
    slack = 1.0 + 8.0 * (len(lo) + 2) * arithmetic.unit
    return (total * slack <= sizes.most).astype(int)
