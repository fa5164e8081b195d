"""Claims about a function with a Newton block, decided over boxes: the Krawczyk operator proves that there is one
solution, Kantorovich's bound that Newton's method of the generated code reaches it.

With C = J(z0)^-1 and z = z0 + M (a - a0) + w, M = dz/da at the midpoint, K(W) = -C r(z0 + M (a - a0), a) + (I - C J) W
maps W into itself only if there is exactly one solution in W for every a of the box (Rump, Acta Numerica 2010). From a
start within e of it, a step of Newton's method leaves at most beta L e^2 / 2, beta a bound of |J^-1| and L one of the
second derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..cgen.newton_stages import stages
from ..cgen.newton_steps import CONTRACTION, REACH, STEPS
from ..cgen.real import DOUBLE as REAL
from ..compiler.causal import CausalFunction
from ..results.refusal import ArgumentError
from ..results.status import Status
from .claims import SOLVED, STATUS, Claim, of_margin
from .closed_form import FINITE, SMALL, inputs_are_small
from .intervals import Array, Interval, add, negative, point
from .regularity import about, along, product, remainder
from .rounding import DOUBLE, GROWN
from .subdivision import SHORTEST, Decision, Leaves
from .tape import IntervalTape, MeanValue

ONE = Claim(SOLVED, "exactly one solution in the region of the assembly mode")
REACHED = Claim(SOLVED, "Newton's method of the code reaches it from the answer of the last cycle")
ATTEMPTS = 3
# largest beta L e / 2 with which the steps shrink as the code demands, with room for round-off
SHRINKING = 0.14
# largest round-off of a step, in nominals: beside the limit below which the code lets steps grow
QUIET = 5e-12
# largest distance of an answer from the solution, in nominals, from which the next call may start
ANSWER = 1e-9


class NewtonProver:
    """A Prover for a function with one Newton block. `away` (inputs,): how far the inputs move in one cycle; None: the
    claim REACHED is not made, and errors are bounded by the tolerance of the code."""

    def __init__(self, function: CausalFunction, bounds: Sequence[Claim], away: Array | None) -> None:
        if len(function.kernels) != 1:
            raise ArgumentError(
                f"{function.name} has {len(function.kernels)} Newton blocks; certificates take one", "function"
            )
        cut = stages(function, f"certified_{function.name}", REAL)
        if cut.loops is not None:
            raise ArgumentError(f"the C code of {function.name} has loops, whose rounding is not bounded", "function")
        self.function, self.real, self.away = function, REAL, away
        (self._kernel,), (stage,) = function.kernels, cut.newton
        self.scale = np.asarray(self._kernel.scale, dtype=float)
        self.inputs, self.unknowns = sum(s.size for s in function.inputs), len(self.scale)
        self.targets = sum(s.size for s in function.outputs)
        self.limit, self.least = 1.0 / np.asarray(stage.largest), stage.least
        self._residual, self._by_inputs = IntervalTape(self._kernel.residual), IntervalTape(self._kernel.sensitivity)
        self._curvature = MeanValue(self._residual, range(self.unknowns, self.unknowns * (1 + self.unknowns)))
        self._prepare, self._step = IntervalTape(stage.prepare), IntervalTape(stage.kernel)
        self._constants = stage.constants
        self._body = IntervalTape(cut.body)
        self._centred = MeanValue(self._body, range(self._body.outputs))
        before = [of_margin(m, k + self._constants, REAL) for k, m in enumerate(stage.margins)]
        after = [of_margin(m, k + self.targets, REAL) for k, m in enumerate(cut.margins)]
        self._before, self._after = before, [*after, *bounds]
        self.claims = [SMALL, ONE, *before, *self._after, FINITE, *([] if away is None else [REACHED])]

    def decide(self, lo: Array, hi: Array) -> Decision:
        """Judge boxes."""
        n = lo.shape[1]
        away = np.zeros((self.inputs, 1)) if self.away is None else self.away[:, None]
        with np.errstate(all="ignore"):
            low, high = np.nextafter(lo - away, -np.inf), np.nextafter(hi + away, np.inf)
            middle, way = about(low, high)
            z = self._solutions(middle)
            region = _Region(self, middle, z, low, high, way)
            start = region.motion(away) + ANSWER if self.away is not None else np.zeros(n)
            e = self._newton(region, start, low, high)
            states = [inputs_are_small(self.function.sizes, self._sizes, lo, hi, DOUBLE), region.proved.astype(int)]
            prepared = self._prepare.over(low, high, DOUBLE)
            assert prepared.error is not None
            a, b = prepared.lo - GROWN * prepared.error, prepared.hi + GROWN * prepared.error
            states += [np.where(region.proved, c.states(a[c.output], b[c.output]), 0) for c in self._before]
            result = self._results(region, low, high, way, e)
            states += [
                np.where(region.proved, c.states(result[0][c.output], result[1][c.output]), 0) for c in self._after
            ]
            t = slice(self.targets)
            finite = np.isfinite(result[0][t]).all(axis=0) & np.isfinite(result[1][t]).all(axis=0)
            states.append((region.proved & finite).astype(int))
            if self.away is not None:
                states.append((region.proved & region.reached).astype(int))
            width = hi - lo
            if not hasattr(self, "_whole"):
                self._whole = np.where(width.max(axis=1) > 0, width.max(axis=1), 1.0)
            share = width / self._whole[:, None]
            side = np.where(share.max(axis=0) > SHORTEST, np.argmax(share, axis=0), -1)
        worst = np.vstack([result[2][t], result[1][t], -result[0][t], np.where(region.reached, region.steps, 0)[None]])
        return Decision(np.array(states), side, worst.reshape(-1, n))

    @property
    def _sizes(self) -> list[int]:
        return [s.size for s in self.function.inputs]

    def _solutions(self, a: Array) -> Array:
        """Return the solutions (unknowns, n) of the declared assembly mode at points, by the function itself; NaN
        without one. Only centres of regions: what holds around them is proved."""
        first = np.cumsum(self._sizes)[:-1]
        arguments = [c.T if s.shape else c[0] for s, c in zip(self.function.inputs, np.split(a, first), strict=True)]
        zs, status = self.function.unknowns(*arguments)
        return np.where(status == 0, zs[0].T, np.nan)

    def _newton(self, region: _Region, start: Array, low: Array, high: Array) -> Array:
        """Set whether Newton's method reaches the solution from a distance `start`, in nominals, and return bounds (n,)
        of the distance of the answer from the solution, in nominals."""
        jacobian = region.around(start)
        beta, pivots = region.inverse_bounds(jacobian)
        z = region.z_around(start)
        # round-off of a residual: its constants first, then the steps of the kernel
        prepared = self._prepare.over(low, high, DOUBLE)
        assert prepared.error is not None
        c = slice(self._constants)
        inputs = [
            np.vstack(x) for x in ((z.lo, prepared.lo[c]), (z.hi, prepared.hi[c]), (0.0 * z.lo, prepared.error[c]))
        ]
        kernel = self._step.over(inputs[0], inputs[1], DOUBLE, given=inputs[2])
        assert kernel.error is not None
        m = self.unknowns
        noise = kernel.error[:m].max(axis=0)
        size = np.maximum(np.abs(kernel.lo[m:]), np.abs(kernel.hi[m:])).max(axis=0)
        # LU with partial pivoting: backward error of 3 n u |L| |U|, doubled for the inverse of
        # the pivot, with growth up to 2^(n - 1); and round-off of J
        perturbed = kernel.error[m:].max(axis=0) * m + 6.0 * m**3 * DOUBLE.unit * 2.0 ** (m - 1) * size
        spoilt = beta * perturbed * self.scale.max() * GROWN
        half = 0.5 * region.curvature(self._curvature, z, jacobian)
        quiet = beta * noise * 2.0 + 4.0 * DOUBLE.unit * region.largest(z)
        e, steps = start.copy(), np.zeros(len(start))
        for k in range(STEPS):
            e = (half * e * e + 2.0 * spoilt * e + quiet) * GROWN
            steps = np.where((e > 3.0 * quiet) & (steps == k), k + 1, steps)
        norm = self.limit.min()
        rest = region.row_sums(jacobian) * e * GROWN + noise
        good = (half * start + 2.0 * spoilt <= SHRINKING) & (start * (1.0 + SHRINKING) + quiet <= REACH)
        good &= (quiet <= QUIET) & (e <= ANSWER) & (rest <= norm) & (pivots > self.least * (1.0 + 2.0**-20) + perturbed)
        assert CONTRACTION == 0.25
        region.reached = good & region.proved
        region.steps = np.minimum(steps + 1, STEPS)
        tolerance = beta * (self.limit.max() + noise) * GROWN
        return e if self.away is not None else tolerance

    def _results(self, region: _Region, low: Array, high: Array, way: Interval, e: Array) -> tuple[Array, Array, Array]:
        """Return enclosures of the computed targets and margins, and bounds of their errors, (outputs, n) each."""
        z = region.z
        given = np.vstack([0.0 * low, e * self.scale[:, None]])
        natural = self._body.over(np.vstack([low, z.lo]), np.vstack([high, z.hi]), DOUBLE, given=given)
        at_point = np.vstack([region.middle, region.centre])
        at = self._body.over(at_point, at_point)
        slopes = self._centred.slopes(np.vstack([low, z.lo]), np.vstack([high, z.hi]))
        k = self.inputs
        # slopes by the inputs and through the tangent are added before they meet the way
        by_z = Interval(slopes.lo[:, k:], slopes.hi[:, k:])
        by_a = add(Interval(slopes.lo[:, :k], slopes.hi[:, :k]), _times(by_z, region.tangents))
        total = add(add(Interval(at.lo, at.hi), along(by_a, way)), along(by_z, region.w))
        usable = natural.continuous & ~np.isnan(total.lo)
        lo = np.where(usable, np.maximum(natural.lo, total.lo), natural.lo)
        hi = np.where(usable, np.minimum(natural.hi, total.hi), natural.hi)
        assert natural.error is not None
        error = GROWN * natural.error
        return np.nextafter(lo - error, -np.inf), np.nextafter(hi + error, np.inf), natural.error

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


class _Region:
    """The tube z0 + M (a - a0) + W around the solutions over boxes, and whether it holds exactly one for every a."""

    def __init__(self, prover: NewtonProver, middle: Array, z: Array, low: Array, high: Array, way: Interval) -> None:
        self.prover, self.middle, self.centre, self.low, self.high = prover, middle, z, low, high
        kernel, m = prover._kernel, prover.unknowns
        n = z.shape[1]
        jacobian = kernel._evaluate(z, middle)[1]
        by_a = kernel._sensitivities(z, middle).transpose(1, 0, 2)
        self.inverse = np.full((n, m, m), np.nan)
        for k in range(n):
            if np.isfinite(jacobian[k]).all() and np.linalg.cond(jacobian[k]) < 1e12:
                self.inverse[k] = np.linalg.inv(jacobian[k])
        M = -self.inverse @ by_a
        self.tangents = Interval(M.transpose(1, 2, 0), M.transpose(1, 2, 0))
        self._tube = add(point(z), along(self.tangents, way))
        J, Ja = self._jacobian(self._tube), self._jacobian_by_a(self._tube)
        C = point(self.inverse)
        slant = product(C, add(product(J, point(M)), Ja))  # C dr/da along the tube: small
        at = np.vstack([z, middle])
        here = prover._residual.over(at, at)
        r0 = Interval(here.lo[:m].T[:, :, None], here.hi[:m].T[:, :, None])
        ways = Interval(way.lo.T[:, :, None], way.hi.T[:, :, None])
        g = add(product(C, r0), product(slant, ways))
        floor = 1e-13 * prover.scale
        w = 2.0 * g.magnitude[:, :, 0] + floor
        self.proved, best = np.zeros(n, dtype=bool), np.full((n, m), np.nan)
        for _ in range(ATTEMPTS):
            tube = self._tube.widened(w.T)
            K = add(
                negative(g),
                product(remainder(self.inverse, self._jacobian(tube)), Interval(-w[:, :, None], w[:, :, None])),
            )
            mapped = K.magnitude[:, :, 0]
            inside = (mapped < w).all(axis=1) & ~self.proved
            best[inside] = mapped[inside]
            self.proved |= inside
            w = np.where(self.proved[:, None], best, 1.3 * mapped + floor)
        self.w = Interval(-best.T, best.T)
        self.z = self._tube.widened(best.T)
        self.reached, self.steps = np.zeros(n, dtype=bool), np.zeros(n)

    def corners(self, z: Interval, low: Array, high: Array) -> tuple[Array, Array]:
        """Return boxes of the unknowns, then of the inputs."""
        return np.vstack([z.lo, low]), np.vstack([z.hi, high])

    def _jacobian(self, z: Interval) -> Interval:
        """NaN where the residual or its Jacobian may jump, which no theorem here allows."""
        m = self.prover.unknowns
        e = self.prover._residual.over(*self.corners(z, self.low, self.high))
        ends = (np.where(e.continuous, x[m:], np.nan) for x in (e.lo, e.hi))
        return Interval(*(x.reshape(m, m, -1).transpose(2, 1, 0) for x in ends))

    def _jacobian_by_a(self, z: Interval) -> Interval:
        m = self.prover.unknowns
        e = self.prover._by_inputs.over(*self.corners(z, self.low, self.high))
        return Interval(*(x.reshape(-1, m, x.shape[1]).transpose(2, 1, 0) for x in (e.lo, e.hi)))

    def z_around(self, distance: Array) -> Interval:
        """Return the region widened by a distance in nominals."""
        return self.z.widened(distance * self.prover.scale[:, None] * GROWN)

    def around(self, distance: Array) -> Interval:
        """Return the Jacobian over the widened region."""
        return self._jacobian(self.z_around(distance))

    def motion(self, away: Array) -> Array:
        """Return how far the solution moves while the inputs move by `away`, in nominals: |M| and its change."""
        s = self.prover.scale
        J, M = self._jacobian(self.z), point(self.tangents.lo.transpose(2, 0, 1))
        slant = product(point(self.inverse), add(product(J, M), self._jacobian_by_a(self.z)))
        change = slant.magnitude / s[None, :, None]
        moved = ((np.abs(self.tangents.lo).transpose(2, 0, 1) / s[None, :, None]) @ away).max(axis=(1, 2))
        more = (change @ away).max(axis=(1, 2)) / self._contraction(J) * GROWN
        return (moved + more) * GROWN

    def curvature(self, form: MeanValue, z: Interval, jacobian: Interval) -> Array:
        """Return bounds of |J^-1| times the second derivatives, per nominals of the unknowns squared."""
        m, s = self.prover.unknowns, self.prover.scale
        slopes = form.slopes(*self.corners(z, self.low, self.high))
        # Jacobian entries are stacked by columns: entry j m + i is d r_i / d z_j
        second = Interval(*(x[:, :m].reshape(m, m * m, -1).transpose(2, 0, 1) for x in (slopes.lo, slopes.hi)))
        rows = Interval(*(x.reshape(-1, m, m, m).transpose(0, 2, 1, 3).reshape(-1, m, m * m) for x in second))
        size = product(point(self.inverse), rows).magnitude.reshape(-1, m, m, m) / s[None, :, None, None]
        total = (size * s[None, None, :, None] * s[None, None, None, :]).sum(axis=(2, 3)).max(axis=1)
        return total / self._contraction(jacobian)

    def _contraction(self, jacobian: Interval) -> Array:
        """Return a lower bound of 1 - |I - C J| in nominals; NaN if it may be negative."""
        s = self.prover.scale
        rest = remainder(self.inverse, jacobian).magnitude * s[None, None, :] / s[None, :, None]
        left = np.nextafter(1.0 - rest.sum(axis=2).max(axis=1) * GROWN, -np.inf) / GROWN
        return np.where(left > 0, left, np.nan)

    def inverse_bounds(self, jacobian: Interval) -> tuple[Array, Array]:
        """Return bounds of |J^-1| from residuals to nominals of the unknowns, and of the smallest pivot from below: a
        pivot is the greatest entry of a column of a Schur complement, whose inverse is a part of J^-1."""
        s = self.prover.scale
        rest, inverse = remainder(self.inverse, jacobian).magnitude, np.abs(self.inverse)
        plain = rest.sum(axis=2).max(axis=1) * GROWN
        beta = (inverse / s[None, :, None]).sum(axis=2).max(axis=1) / self._contraction(jacobian) * GROWN
        whole = inverse.sum(axis=2).max(axis=1) / (1.0 - plain) * GROWN
        return beta, np.where(plain < 1.0, 1.0 / whole, np.nan)

    def row_sums(self, jacobian: Interval) -> Array:
        """Return the largest change of a residual per nominal of the unknowns."""
        return (jacobian.magnitude * self.prover.scale[None, None, :]).sum(axis=2).max(axis=1) * GROWN

    def largest(self, z: Interval) -> Array:
        """Return the largest unknown in nominals."""
        return (z.magnitude / self.prover.scale[:, None]).max(axis=0)


def _times(a: Interval, b: Interval) -> Interval:
    """Return matrices (m, k, n) times (k, j, n) -> (m, j, n)."""
    rows = product(*(Interval(x.lo.transpose(2, 0, 1), x.hi.transpose(2, 0, 1)) for x in (a, b)))
    return Interval(rows.lo.transpose(1, 2, 0), rows.hi.transpose(1, 2, 0))
