"""The mass whose weight explains the middle levels of friction, by three norms, and the forces with which the
actuators hold one kilogram at the tool."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
import scipy

from ...compiler.causal import flat_of
from ...lang import Model, ModelError
from ...results import ArgumentError, Status, naming
from ...results.trajectory_checks import Array
from .options import HeldPose

Weighed = Callable[[Sequence[float]], np.ndarray]
PLATE = "m_p"  # mass of the plate, payload included, in all robots of the library


def gravity_pattern(robot: Model, poses: Sequence[HeldPose]) -> np.ndarray:
    """Force of each cart that holds one kilogram at the tool (poses, carts) [N/kg], by geometry or as printed.

    A pose gives its tool centre point, for which the robot's model is asked, or printed forces with the mass they hold.
    Raises ArgumentError for a pose that says neither or both, or cannot be reached, and for a robot that its tool
    centre point does not place or whose plate has no mass.

    >>> pose = gt.identify.HeldPose(tcp=[0.5, -0.9, 0.3])
    >>> gt.identify.gravity_pattern(gt.robots.gantry_tau("l1_tape"), [pose]).round(2)
    array([[-9.54, -0.41,  9.95]])
    """
    if not poses:
        raise ArgumentError("is empty; expected one or more", "poses")
    weigh = cache(lambda: _by_geometry(robot))
    rows = [_holding(pose, f"poses[{n}]", weigh) for n, pose in enumerate(poses)]
    if len({len(row) for row in rows}) > 1:
        raise ArgumentError(
            f"the poses have {', '.join(str(len(r)) for r in rows)} carts; expected one number", "poses"
        )
    return np.array(rows)


def _holding(pose: HeldPose, argument: str, weigh: Callable[[], Weighed]) -> np.ndarray:
    if (pose.tcp is None) == (pose.holding is None):
        raise ArgumentError("expected either tcp or holding with holding_mass", argument)
    if pose.tcp is not None:
        weighed = weigh()
        with naming(f"{argument}.tcp", ValueError):
            return weighed(pose.tcp)
    if pose.holding_mass is None:
        raise ArgumentError("is missing; expected the mass that holding holds, in kg", f"{argument}.holding_mass")
    return np.array(pose.holding) / pose.holding_mass


def _by_geometry(robot: Model) -> Weighed:
    """Tool centre point [m] -> forces that hold one kilogram more [N]; friction is in both cases and falls out."""
    masses = {p.name: p.value for p in flat_of(robot).parameters}
    if masses.get(PLATE) is None:
        raise ArgumentError(
            f"has no mass '{PLATE}' of its plate, so its geometry does not tell what the carts hold; "
            "give the poses' holding",
            "robot",
        )
    try:
        inverse = [m.causal(known="T", targets="tau") for m in (robot, robot.with_(**{PLATE: masses[PLATE] + 1.0}))]
    except ModelError as error:
        said = f"a tool centre point alone does not place it, as it does with three links ({error})"
        raise ArgumentError(said, "robot") from error

    def weighed(tcp: Sequence[float]) -> np.ndarray:
        width = inverse[0].inputs[0].size
        if len(tcp) != width:
            raise ValueError(f"expected a list of {width} numbers in m")
        at_rest = [np.zeros(width)] * (len(inverse[0].inputs) - 1)
        forces = []
        for function in inverse:
            tau, status = function(tcp, *at_rest)
            if status is not Status.OK:
                raise ValueError(f"{tcp} m cannot be reached: {status.message}")
            forces.append(np.asarray(tau))
        return forces[1] - forces[0]

    return weighed


Gravity = Literal["most_symmetric", "poses"]  # how the mass is found beside friction by direction
PARALLEL = 1e-6  # patterns closer to parallel than this: the difference of gravity between poses determines no mass
TIE = 1e-9  # of the sum of weights: two sides of a median that weigh the same


class MassByNorm(NamedTuple):
    """Masses [kg] that make the asymmetry middle - m pattern least, by norm.

    `two` is that of the 2-norm, `one` the interval in which the 1-norm is least (both ends equal where it is a point),
    `maximum` that of the maximum norm.
    """

    two: float
    one: tuple[float, float]
    maximum: float


def mass_by_norm(middle: Array, pattern: Array) -> MassByNorm:
    """Masses from the middle levels [N] and the forces that hold one kilogram [N/kg], both (n,) or of any one shape.

    The middle level is the mean of the forces that the lines forwards and backwards reach at velocity zero:
    middle = m pattern + (fc+ - fc-)/2, with the magnitudes fc+ and fc- of Coulomb friction, whose asymmetric part is
    what is left. The 2-norm gives m = middle.pattern / pattern.pattern. Raises ArgumentError for shapes that differ,
    numbers that are not finite, and a pattern of zeros.

    >>> pattern = np.array([-7.9, -0.7, 8.6])
    >>> masses = gt.identify.mass_by_norm(20.0 * pattern + np.array([10.0, 0.0, 0.0]), pattern)
    >>> round(masses.two, 2), round(masses.one[0], 2), round(masses.maximum, 2)  # the 1-norm leaves an outlier alone
    (19.42, 20.0, 19.39)
    """
    c, g = np.asarray(middle, float), np.asarray(pattern, float)
    if c.shape != g.shape:
        raise ArgumentError(f"has the shape {c.shape}; expected {g.shape}, that of the pattern", "middle")
    if not (np.isfinite(c).all() and np.isfinite(g).all()):
        raise ArgumentError("holds a number that is not finite, or the pattern does", "middle")
    if not np.any(g):
        raise ArgumentError("one kilogram loads no cart, so no force determines the mass", "pattern")
    c, g = c.ravel(), g.ravel()
    return MassByNorm(float(c @ g / (g @ g)), _weighted_median(c, g), _minimax(c, g))


def _weighted_median(c: Array, g: Array) -> tuple[float, float]:
    """sum |c - m g| = sum |g| |c/g - m| is least at the median of c/g with weights |g|; an interval at a tie."""
    c, g = c[g != 0], g[g != 0]
    order = np.argsort(c / g)
    at, weight = (c / g)[order], np.abs(g)[order]
    share = np.cumsum(weight) / weight.sum()
    k = int(np.searchsorted(share, 0.5 - TIE))
    return float(at[k]), float(at[k + 1] if abs(share[k] - 0.5) <= TIE else at[k])


def _minimax(c: Array, g: Array) -> float:
    """Least e with -e <= c - m g <= e, as a linear program in (m, e)."""
    ones = np.ones_like(g)
    upper = np.vstack([np.column_stack([-g, -ones]), np.column_stack([g, -ones])])
    optimum = scipy.optimize.linprog([0, 1], A_ub=upper, b_ub=np.concatenate([-c, c]), bounds=[(None, None), (0, None)])
    return float(optimum.x[0])
