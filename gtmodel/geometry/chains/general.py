"""All postures of a general chain of six revolute joints: the elimination of Raghavan and Roth.

Raghavan, Roth, J. Mech. Des. 115(3), 1993; as a matrix pencil: Manocha, Canny, IEEE Trans. Robotics and Automation
10(5), 1994. It loses postures of chains whose axes meet or are parallel: most of these have closed forms, and of the
others chains slightly off are solved too.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from .chain import Chain
from .structure import NEAR

# angles about which half-angle tangents are taken: a solution near a half turn from one of them is lost to infinity
SHIFTS = np.array([[0.7, -1.1, 0.4], [-1.9, 0.6, 2.3]])
REAL = (
    1e-3  # imaginary part, relative to 1 + |x|, of tangents that may be real: two that nearly meet lose half the digits
)
GRID = np.arange(3) * 2 * np.pi / 3
# values at GRID to the coefficients of 1, cos, sin, and these to those of 1, x, x^2 times 1 + x^2
FIT = np.linalg.inv(np.column_stack([np.ones(3), np.cos(GRID), np.sin(GRID)]))
TANGENT = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, -1.0, 0.0]])
ONE = TANGENT @ [1.0, 0.0, 0.0]


# chains slightly off a chain with parallel or meeting axes: relative size of the differences, and seed
DISTURBED = ((1e-3, 0), (3e-3, 1), (3e-3, 2))


class GeneralArm:
    """The part of the elimination that depends on the chain alone. `structured`: some axes meet or are parallel."""

    def __init__(self, chain: Chain) -> None:
        sines = [np.linalg.norm(np.cross(a, b)) for a, b in pairwise(chain.axes)]
        normals = [np.cross(a, b) for a, b in pairwise(chain.axes)]
        gaps = [abs(n @ d) / chain.size for n, d in zip(normals, np.diff(chain.points, axis=0), strict=True)]
        self.structured = min(sines) < NEAR or min(gaps) < NEAR
        self.eliminations = [_Elimination(chain, shift) for shift in SHIFTS]
        for size, seed in DISTURBED if self.structured else ():
            off = size * np.random.default_rng(seed).standard_normal((2, 6, 3))
            near = Chain(chain.axes + off[0], chain.points + chain.size * off[1], None, chain.T, chain.R)
            self.eliminations.append(_Elimination(near, SHIFTS[0]))

    def candidates(self, T: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return joint angles (k, 6) near all postures of one pose, and possibly further ones."""
        return np.concatenate([elimination(T, R) for elimination in self.eliminations])


class _Elimination:
    """One elimination, with half-angle tangents of joints 3, 4 and 5 about given angles."""

    def __init__(self, chain: Chain, shift: np.ndarray) -> None:
        h, o = chain.axes, chain.points
        self.chain, self.size, self.shift = chain, chain.size, shift
        self.centre = (o[1] + o[2]) / 2  # origin of the fourteen functions
        self.p, self.l = o[5] + h[5] * (h[5] @ (self.centre - o[5])), h[5]
        self.left = self._left(shift)

    def __call__(self, T: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return joint angles (k, 6) of the real and nearly real roots."""
        X = R @ self.chain.R.T
        p, l = X @ (self.p - self.chain.T) + T, X @ self.l
        grid = self._motions((1, 0), -np.stack(np.meshgrid(GRID, GRID, indexing="ij"), -1).reshape(-1, 2)[:, ::-1])
        values = self._functions(grid, p, l).reshape(3, 3, 14)
        right = np.einsum("ai,bj,ijf->fab", FIT, FIT, values).reshape(14, 9)
        return self._with(right, X)

    def _with(self, right: np.ndarray, X: np.ndarray) -> np.ndarray:
        import scipy

        moving, still = right[:, 1:], right[:, 0]
        null = np.linalg.svd(moving)[0][:, 8:]
        constant = np.einsum("f,a,b,c->fabc", still, ONE, ONE, ONE)
        M = np.einsum("fr,fabc->arbc", null, self.left - constant)  # powers of x3; rows; powers of x4, x5
        pencil = np.zeros((3, 12, 4, 3))
        pencil[:, :6, :3], pencil[:, 6:, 1:] = M, M
        low, middle, high = pencil.reshape(3, 12, 12)
        A, B = np.eye(24), np.eye(24)
        A[:12], A[12:] = np.eye(12, 24, 12), np.hstack([-low, -middle])
        B[12:, 12:] = high
        (top, bottom), vectors = scipy.linalg.eig(A, B, homogeneous_eigvals=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            x3 = top / bottom
        keep = np.isfinite(x3) & (np.abs(x3.imag) < REAL * (1 + np.abs(x3)))
        if not keep.any():
            return np.zeros((0, 6))
        v = vectors[:12, keep].T.reshape(-1, 4, 3)
        rows = np.arange(len(v))
        half = [x3[keep].real]
        for w in (v, v.transpose(0, 2, 1)):
            lower, upper = w[:, :-1].reshape(len(v), -1), w[:, 1:].reshape(len(v), -1)
            best = np.argmax(np.abs(lower) ** 2 + np.abs(upper) ** 2, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                half.append((upper[rows, best] / lower[rows, best]).real)
        q = np.zeros((len(v), 6))
        q[:, 2:5] = self.shift + 2 * np.arctan(np.nan_to_num(np.array(half), posinf=1e12, neginf=-1e12)).T
        wanted = self._functions(self._motions((2, 3, 4), q[:, 2:5]), self.p, self.l) - still
        terms = np.linalg.lstsq(moving, wanted.T, rcond=None)[0]
        q[:, 1], q[:, 0] = np.arctan2(terms[1], terms[0]), np.arctan2(terms[5], terms[2])
        rest = self.chain.exponentials(q)[0][5].transpose(0, 2, 1) @ X
        across = np.cross(self.l, np.eye(3)[np.argmin(np.abs(self.l))])
        image = rest @ across
        q[:, 5] = np.arctan2(image @ np.cross(self.l, across), image @ across)
        return q

    def _left(self, shift: np.ndarray) -> np.ndarray:
        """Return the fourteen functions by powers of the tangents of joints 3, 4, 5, (14, 3, 3, 3)."""
        angles = np.stack(np.meshgrid(*[s + GRID for s in shift], indexing="ij"), axis=-1).reshape(-1, 3)
        values = self._functions(self._motions((2, 3, 4), angles), self.p, self.l).reshape(3, 3, 3, 14)
        change = TANGENT @ FIT
        return np.einsum("ai,bj,ck,ijkf->fabc", change, change, change, values)

    def _motions(self, joints: tuple[int, ...], q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations and translations of the product of some joints' motions, in this order."""
        part = list(joints)
        R, p = Chain(self.chain.axes[part], self.chain.points[part]).exponentials(q)
        return R[-1], p[-1]

    def _functions(self, motion: tuple[np.ndarray, np.ndarray], p: np.ndarray, l: np.ndarray) -> np.ndarray:
        """Return (n, 14): of a line moved, point p and direction l, p.p, p.l, p x l and (p.p) l - 2 (p.l) p."""
        R, t = motion
        p, l = (R @ p + t - self.centre) / self.size, R @ l
        pp, pl = (p * p).sum(axis=1, keepdims=True), (p * l).sum(axis=1, keepdims=True)
        return np.hstack([p, l, pp, pl, np.cross(p, l), pp * l - 2 * pl * p])
