"""How straight a guideway is: a line through measured cart points and what is left over."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

MIN_POINTS = 3  # two points leave no residual
# metres per metre: transmission scales are 0.96 to 1.003; a factor of two is another unit or another axis
SCALE_RANGE = (0.5, 2.0)
# m: what spans more was given in millimetres, if no guideway is shorter than the thousandth part, 20 mm
LONGEST = 20.0
STANDSTILL = 1e-3  # m: nothing can be said about a guideway along which the cart moves less


class MeasurementError(ValueError):
    """Measurements that cannot be evaluated; one plain sentence."""


@dataclass(frozen=True, eq=False)
class GuidewayFit:
    """A guideway as measured: cart points P(q) = P0 + q v + e (Dressler 2012, eq. (4.10)), lengths in m.

    P0 (3,) and v (3,) minimise the sum of e.e. v points towards rising q; its length is a transmission scale [m per m],
    so it is no unit vector. `q` (n,) and the residuals `e` (n, 3) are in the order of the measurements.
    """

    P0: np.ndarray
    v: np.ndarray
    q: np.ndarray
    e: np.ndarray

    @property
    def direction(self) -> np.ndarray:
        """Unit vector along the guideway, v / |v| (3,)."""
        return self.v / np.linalg.norm(self.v)

    @cached_property
    def along(self) -> np.ndarray:
        """Part of e along the guideway (n,) [m], signed: e.v / |v|.

        Eq. (4.11) prints e.v, which is |v| times as large (0.96 to 1.003); a length needs the unit vector.
        """
        return self.e @ self.direction

    @cached_property
    def across(self) -> np.ndarray:
        """Part of e orthogonal to the guideway (n, 3) [m], a vector.

        Eq. (4.12) prints e - e_par with a scalar e_par; meant is the vector along the guideway.
        """
        return self.e - np.outer(self.along, self.direction)

    def statistics(self) -> dict[str, float]:
        """Mean, standard deviation (of the sample, n - 1) and maximum of |e|, |e_par| and |e_perp| [m].

        `mean` and `std` are the rows of Dressler 2012, Table 4.1; the others go with Figs. 4.4 and 5.3.
        """
        sizes = {
            "": np.linalg.norm(self.e, axis=1),
            "along_": np.abs(self.along),
            "across_": np.linalg.norm(self.across, axis=1),
        }
        statistics: dict[str, float] = {}
        for name, size in sizes.items():
            statistics |= {
                f"{name}mean": float(np.mean(size)),
                f"{name}std": float(np.std(size, ddof=1)),
                f"{name}max": float(np.max(size)),
            }
        return statistics

    def modifiers(self, R: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """`at` (k,) and `deviation` (k, 3) for PiecewiseLinearGuideway or SplineGuideway: q sorted, and e there.

        Measurements at one q are averaged. R (3, 3) turns measurement into robot coordinates where these differ
        (Dressler 2012, Table 5.2); where the points lie drops out, for A and v of the robot's own links stand for it.
        """
        at, which = np.unique(self.q, return_inverse=True)
        deviation = np.zeros((len(at), 3))
        np.add.at(deviation, which, self.e)
        deviation /= np.bincount(which)[:, None]
        return {"at": at, "deviation": deviation if R is None else deviation @ np.asarray(R, float).T}


def fit_guideway(q: Any, P: Any, *, longest: float = LONGEST) -> GuidewayFit:
    """Fit a line to cart points that were measured along one guideway (Dressler 2012, eqs. (4.10)-(4.12)).

    Args:
        q: commanded cart coordinates (n,) [m], in any order, n >= 3.
        P: measured points (n, 3) [m], any frame.
        longest: guideway that may be meant [m]; raise it for a robot that is larger.

    Raises MeasurementError: too few points, numbers that are not finite, a cart that does not move, lengths that
    look like millimetres.

    >>> q = np.linspace(0.0, 2.0, 21)
    >>> straight = np.outer(q, [0.99, 0.0, 0.0]) + [0.0, 0.0, 1.0]
    >>> bent = straight + np.outer(np.sin(np.pi * q), [0.0, 0.0, 1e-4])  # 0.1 mm up and down
    >>> fit = gt.kinematics.fit_guideway(q, bent)
    >>> np.linalg.norm(fit.v).round(3), round(1e3 * fit.statistics()["across_max"], 3)  # transmission scale; mm
    (np.float64(0.99), 0.082)
    """
    q, P = checked(q, P, longest)
    design = np.column_stack([np.ones(len(q)), q - np.mean(q)])
    (middle, v), *_ = np.linalg.lstsq(design, P, rcond=None)
    scale = float(np.linalg.norm(v))
    low, high = SCALE_RANGE
    if scale < STANDSTILL / np.ptp(q) or np.max(np.linalg.norm(P - P[0], axis=1)) < STANDSTILL:
        raise MeasurementError(
            f"the points move by less than {1e3 * STANDSTILL:g} mm while q runs over {np.ptp(q):.4g} m; give the "
            "points of the cart that q drives"
        )
    if not low <= scale <= high:
        hint = "one of them is in millimetres, or q belongs to another cart" if _thousand(scale) else "check the units"
        raise MeasurementError(
            f"the points move {scale:.4g} m per metre of q, expected 0.96 to 1.003, at least {low:g} to "
            f"{high:g}; {hint}"
        )
    return GuidewayFit(P0=middle - np.mean(q) * v, v=v, q=q, e=P - middle - np.outer(q - np.mean(q), v))


def checked(q: Any, P: Any, longest: float = LONGEST) -> tuple[np.ndarray, np.ndarray]:
    """q (n,) and P (n, 3) as arrays. Raises MeasurementError."""
    q, P = np.asarray(q, dtype=float), np.asarray(P, dtype=float)
    if q.ndim != 1 or P.shape != (len(q), 3):
        raise MeasurementError(f"expected q of shape (n,) and points of shape (n, 3); found {q.shape} and {P.shape}")
    if len(q) < MIN_POINTS:
        raise MeasurementError(f"a line and its residuals need at least {MIN_POINTS} points; found {len(q)}")
    bad = np.flatnonzero(~(np.isfinite(q) & np.all(np.isfinite(P), axis=1)))
    if bad.size:
        more = f" and {bad.size - 1} more" if bad.size > 1 else ""
        raise MeasurementError(f"row {bad[0]}{more} (counted from 0) is not finite; leave such rows out")
    span = float(np.ptp(q))
    if span < STANDSTILL:
        raise MeasurementError(f"q runs over {span:.3g} m only; the cart has to move along its guideway")
    if span > longest:
        raise MeasurementError(
            f"q runs over {span:.4g} m, more than {longest:g}; give metres, not millimetres, or say by `longest` that "
            "the guideway is longer"
        )
    return q, P


def _thousand(scale: float) -> bool:
    """Whether a ratio is about 1000 or its inverse."""
    return 0.5 < abs(np.log10(scale)) / 3 < 1.5
