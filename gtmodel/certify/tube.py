"""The tube of solutions of a Newton block over a box of its inputs: one solution for every input (Krawczyk operator;
Rump, *Verification methods*, Acta Numerica 2010).

Around a solution z0 for the midpoint a0 with C = J^-1 and M = dz/da there, the tube is z = z0 + M (a - a0) + w. In the
coordinates u = (w, a - a0) the derivative C [dr/dz, dr/da] is [I, 0] at the midpoint, so that enclosures of the second
derivatives, in these coordinates, leave little to lose.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.newton import NewtonKernel
from .intervals import Array, Interval, add, multiply, negative, point
from .regularity import about, along, product
from .rounding import GROWN
from .tape import IntervalTape, MeanValue, with_jacobian

ATTEMPTS = 3
_FLOOR = 1e-11  # least half width of a tube in nominals: round-off of the midpoint


class KernelDerivatives:
    """Residual and first and second derivatives of a Newton block, by unknowns (m) and inputs (k)."""

    def __init__(self, kernel: NewtonKernel) -> None:
        z, a = kernel.residual.sx_in()
        self.m, self.k = z.numel(), a.numel()
        self.residual = IntervalTape(ca.Function("residual", [z, a], [ca.densify(kernel.residual(z, a)[0])]))
        self.first = with_jacobian(self.residual, range(self.m), beside=True)[1]
        self._second = MeanValue(self.first, range(self.m, self.first.outputs))

    def at(self, z: Array, a: Array) -> tuple[Interval, Interval]:
        """Return residuals (n, m, 1) and derivatives (n, m, m + k) at points."""
        x = np.vstack([z, a])
        e = self.first.over(x, x)
        m, both = self.m, self.m + self.k
        return (
            Interval(*(y[:m].T[:, :, None] for y in (e.lo, e.hi))),
            Interval(*(y[m:].reshape(both, m, -1).transpose(2, 1, 0) for y in (e.lo, e.hi))),
        )

    def over(self, z: Interval, lo: Array, hi: Array) -> tuple[Interval, Interval]:
        """Return over boxes the Jacobian by the unknowns (n, m, m), and the second derivatives (n, m, m + k, m + k);
        NaN where the first ones may jump, which no theorem here allows."""
        ends = np.vstack([z.lo, lo]), np.vstack([z.hi, hi])
        m, both = self.m, self.m + self.k
        e, slopes = self.first.over(*ends), self._second.slopes(*ends)
        jacobian, second = ([np.where(e.continuous, x, np.nan) for x in pair] for pair in ((e.lo, e.hi), slopes))
        return (
            Interval(*(x[m : m * (1 + m)].reshape(m, m, -1).transpose(2, 1, 0) for x in jacobian)),
            Interval(*(x.reshape(both, m, both, -1).transpose(3, 1, 0, 2) for x in second)),
        )


class Tube:
    """Tubes around solutions z0 (m, n) at the midpoints of boxes lo, hi (k, n), and where they hold exactly one
    solution for every input: `proved` (n,). w: half widths (m, n), NaN elsewhere; z: their hull."""

    def __init__(self, derivatives: KernelDerivatives, scale: Array, z0: Array, lo: Array, hi: Array) -> None:
        self._derivatives, self.scale, self.centre, self.lo, self.hi = derivatives, scale, z0, lo, hi
        self.middle, self.way = about(lo, hi)
        m, n = z0.shape
        r0, d0 = derivatives.at(z0, self.middle)
        self.inverse = np.full((n, m, m), np.nan)
        for k, J in enumerate(d0.lo[:, :, :m]):
            if np.isfinite(J).all() and np.linalg.cond(J) < 1e12:
                self.inverse[k] = np.linalg.inv(J)
        M = -self.inverse @ d0.lo[:, :, m:]
        self.tangents = Interval(M.transpose(1, 2, 0), M.transpose(1, 2, 0))
        self._c = point(self.inverse)
        d = product(self._c, d0)
        self._first = _joined(_part(d, 0, m), add(_part(d, m, None), product(_part(d, 0, m), point(M))))
        self._r0 = product(self._c, r0)
        self._line = add(point(z0), along(self.tangents, self.way))
        self._find()

    def _find(self) -> None:
        m, n = self.centre.shape
        floor = _FLOOR * self.scale[:, None]
        self.proved, self.w = np.zeros(n, dtype=bool), np.full((m, n), np.nan)
        self.unique = self.w.copy()  # half widths in which there is no other solution
        w = 2.0 * self._image(self._line, np.zeros((m, n)))[1] + floor
        for _ in range(ATTEMPTS):
            mapped, _ = self._image(self._line.widened(w), w)
            inside = (mapped < w).all(axis=0) & ~self.proved
            self.w[:, inside], self.unique[:, inside] = mapped[:, inside], w[:, inside]
            self.proved |= inside
            if self.proved.all():
                break
            w = 1.3 * mapped + floor
        self.z = self._line.widened(self.w)

    def _image(self, z: Interval, w: Array) -> tuple[Array, Array]:
        """Return the half widths (m, n) of the Krawczyk image of |w| <= `w`, and of its part from the residual."""
        m = len(self.scale)
        _, second = self._derivatives.over(z, self.lo, self.hi)
        second = self._turned(second)
        way = Interval(*(x.T[:, :, None] for x in self.way))
        bend = Interval(*(x[:, :, m:, m:] for x in second))
        # on the line w = 0: C r = C r(z0) + slant da + da bend da / 2
        slant = add(_part(self._first, m, None), _half(_times(bend, self.way)))
        g = add(self._r0, product(slant, way))
        rest = self._rest(second, w)
        size = w.T[:, :, None]
        image = add(negative(g), product(rest, Interval(-size, size)))
        return image.magnitude[:, :, 0].T, g.magnitude[:, :, 0].T

    def _turned(self, second: Interval) -> Interval:
        """Return C times the second derivatives in the coordinates (w, a - a0), (n, m, m + k, m + k)."""
        n, m, both, _ = second.lo.shape
        d = product(self._c, Interval(*(x.reshape(n, m, both * both) for x in second)))
        d = Interval(*(x.reshape(n, m, both, both) for x in d))
        M = point(self.tangents.lo.transpose(2, 0, 1))
        for axes in ((0, 1, 3, 2), (0, 1, 3, 2)):  # the columns, then the rows
            flat = Interval(*(x.reshape(n, m * both, both) for x in d))
            turned = _joined(_part(flat, 0, m), add(_part(flat, m, None), product(_part(flat, 0, m), M)))
            d = Interval(*(x.reshape(n, m, both, both).transpose(axes) for x in turned))
        return d

    def _rest(self, second: Interval, w: Array) -> Interval:
        """Return I - C J (n, m, m) over |w| <= `w`."""
        m = len(self.scale)
        ways = Interval(np.vstack([-w, self.way.lo]), np.vstack([w, self.way.hi]))
        change = _times(Interval(*(x[:, :, :m] for x in second)), ways)
        return add(add(point(np.eye(m)[None]), negative(_part(self._first, 0, m))), negative(change))

    def around(self, distance: Array) -> Surroundings:
        """Return what holds within a distance (n,), in nominals, of the solutions."""
        w = (self.w + distance * self.scale[:, None]) * GROWN
        z = self._line.widened(w)
        jacobian, second = self._derivatives.over(z, self.lo, self.hi)
        second = self._turned(second)
        m = len(self.scale)
        ways = Interval(np.vstack([-w, self.way.lo]), np.vstack([w, self.way.hi]))
        slant = add(_part(self._first, m, None), _times(Interval(*(x[:, :, m:] for x in second)), ways))
        return Surroundings(self, z, jacobian, self._rest(second, w), slant, second.magnitude[:, :, :m, :m])


class Surroundings:
    """Bounds within some distance of the solutions of a tube. z: the region; rest: I - C J; slant: C (dr/da + J M);
    curvature: |C r''|."""

    def __init__(
        self, tube: Tube, z: Interval, jacobian: Interval, rest: Interval, slant: Interval, curvature: Array
    ) -> None:
        self.tube, self.z, self._jacobian, self._slant, self._curvature = tube, z, jacobian, slant, curvature
        s = tube.scale
        self._rest = rest.magnitude
        norm = (self._rest * s[None, None, :] / s[None, :, None]).sum(axis=2).max(axis=1) * GROWN
        left = np.nextafter(1.0 - norm, -np.inf) / GROWN
        # lower bounds (n,) of 1 - |I - C J| in nominals; NaN if it may be negative
        self.contraction = np.where(left > 0, left, np.nan)
        self._norm = norm

    def derivative(self) -> Interval:
        """Return dz/da (m, k, n): M - (C J)^-1 slant."""
        s, slant = self.tube.scale, self._slant.magnitude
        most = (slant / s[None, :, None]).max(axis=1, keepdims=True)
        error = (slant + (self._norm / self.contraction)[:, None, None] * s[None, :, None] * most) * GROWN
        return self.tube.tangents.widened(error.transpose(1, 2, 0) * GROWN)

    def motion(self, away: Array) -> Array:
        """Return how far the solution moves at most while the inputs move by `away` (k,), in nominals."""
        size = self.derivative().magnitude / self.tube.scale[:, None, None]
        return (size * away[None, :, None]).sum(axis=1).max(axis=0) * GROWN

    def bend(self) -> Array:
        """Return bounds of |J^-1 r''|, per nominals of the unknowns squared."""
        s = self.tube.scale
        size = self._curvature / s[None, :, None, None] * s[None, None, :, None] * s[None, None, None, :]
        return size.sum(axis=(2, 3)).max(axis=1) / self.contraction * GROWN

    def inverse_bounds(self) -> tuple[Array, Array]:
        """Return bounds of |J^-1| from residuals to nominals of the unknowns, and of the smallest pivot from below: a
        pivot is the greatest entry of a column of a Schur complement, whose inverse is a part of J^-1."""
        s, inverse = self.tube.scale, np.abs(self.tube.inverse)
        plain = self._rest.sum(axis=2).max(axis=1) * GROWN
        beta = (inverse / s[None, :, None]).sum(axis=2).max(axis=1) / self.contraction * GROWN
        whole = inverse.sum(axis=2).max(axis=1) / (1.0 - plain) * GROWN
        return beta, np.where(plain < 1.0, 1.0 / whole, np.nan)

    def row_sums(self) -> Array:
        """Return the largest change of a residual per nominal of the unknowns."""
        return (self._jacobian.magnitude * self.tube.scale[None, None, :]).sum(axis=2).max(axis=1) * GROWN

    def largest(self) -> Array:
        """Return the largest unknown in nominals."""
        return (self.z.magnitude / self.tube.scale[:, None]).max(axis=0)


def _part(x: Interval, first: int, last: int | None) -> Interval:
    return Interval(x.lo[..., first:last], x.hi[..., first:last])


def _joined(a: Interval, b: Interval) -> Interval:
    return Interval(*(np.concatenate(pair, axis=-1) for pair in zip(a, b, strict=True)))


def _half(x: Interval) -> Interval:
    return Interval(0.5 * x.lo, 0.5 * x.hi)


def _times(tensors: Interval, ways: Interval) -> Interval:
    """Return tensors (n, i, j, d) times vectors (d, n) -> (n, i, j)."""
    total = point(np.zeros(1))
    for d in range(tensors.lo.shape[3]):
        way = Interval(*(x[d][:, None, None] for x in ways))
        term = multiply(Interval(tensors.lo[..., d], tensors.hi[..., d]), way)
        total = term if d == 0 else add(total, term)
    return total
