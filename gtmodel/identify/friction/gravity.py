"""The mass that explains the mean friction levels by its weight, in three norms, and the forces with which the
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
SINGLE_AXIS = '; if no carts carry a plate, as with a single axis, use kind = "identification"'
NO_LOAD = (
    "one kilogram at the tool loads no cart, so that no force determines the mass; check tcp_m, holding_N and the "
    f"direction of gravity{SINGLE_AXIS}"
)
PLATE = "m_p"  # mass of the plate, payload included, in all robots of the library


def gravity_pattern(robot: Model, poses: Sequence[HeldPose]) -> np.ndarray:
    """Return the force of each cart that holds one kilogram at the tool (poses, carts) [N/kg], computed or printed.

    A pose has a tool centre point, from which the robot's model computes the forces, or printed forces with the mass
    that they hold. Raises ArgumentError if a pose has neither or both or is out of reach, if the tool centre point does
    not determine the pose of the robot, and if its plate has no mass.

    >>> pose = gt.identify.HeldPose(tcp=[0.5, -0.9, 0.3])
    >>> gt.identify.gravity_pattern(gt.robots.gantry_tau("l1_tape"), [pose]).round(2)
    array([[-9.54, -0.41,  9.95]])
    """
    if not poses:
        raise ArgumentError("is empty; expected at least one", "poses")
    weigh = cache(lambda: _by_geometry(robot))
    rows = [_holding(pose, f"poses[{n}]", weigh) for n, pose in enumerate(poses)]
    if len({len(row) for row in rows}) > 1:
        raise ArgumentError(
            f"the poses have {', '.join(str(len(r)) for r in rows)} carts; expected the same number for all", "poses"
        )
    return np.array(rows)


def _holding(pose: HeldPose, argument: str, weigh: Callable[[], Weighed]) -> np.ndarray:
    if (pose.tcp is None) == (pose.holding is None):
        raise ArgumentError(
            "expected either a tool centre point (key tcp_m), or printed forces with the mass that they hold (keys "
            f"holding_N and holding_mass_kg){SINGLE_AXIS}",
            argument,
        )
    if pose.tcp is not None:
        weighed = weigh()
        with naming(f"{argument}.tcp", ValueError):
            return weighed(pose.tcp)
    if pose.holding_mass is None:
        raise ArgumentError("is missing; expected the mass in kg that holding_N holds", f"{argument}.holding_mass")
    return np.array(pose.holding) / pose.holding_mass


def _by_geometry(robot: Model) -> Weighed:
    """Tool centre point [m] -> forces that hold one more kilogram [N]; friction cancels in the difference."""
    masses = {p.name: p.value for p in flat_of(robot).parameters}
    if masses.get(PLATE) is None:
        raise ArgumentError(
            f"has no mass '{PLATE}' of its plate, so that its model cannot compute the holding forces; give each pose "
            f"printed forces with the mass that they hold (keys holding_N and holding_mass_kg){SINGLE_AXIS}",
            "robot",
        )
    try:
        inverse = [m.causal(known="T", targets="tau") for m in (robot, robot.with_(**{PLATE: masses[PLATE] + 1.0}))]
    except ModelError as error:
        message = f"the tool centre point does not determine the robot's pose; use a three-link robot ({error})"
        raise ArgumentError(message, "robot") from error

    def weighed(tcp: Sequence[float]) -> np.ndarray:
        width = inverse[0].inputs[0].size
        if len(tcp) != width:
            raise ValueError(f"expected a list of {width} numbers in m")
        at_rest = [np.zeros(width)] * (len(inverse[0].inputs) - 1)
        forces = []
        for function in inverse:
            tau, status = function(tcp, *at_rest)
            if status is not Status.OK:
                raise ValueError(f"{tcp} m is out of reach: {status.message}")
            forces.append(np.asarray(tau))
        return forces[1] - forces[0]

    return weighed


Gravity = Literal["most_symmetric", "poses"]  # how the mass is found if friction may differ by direction
PARALLEL = 1e-6  # patterns closer to parallel than this: the difference of gravity between poses determines no mass
TIE = 1e-9  # relative to the sum of weights: both sides of a median weigh the same


class MassByNorm(NamedTuple):
    """Masses [kg] that minimise the asymmetry middle - m pattern, by norm.

    `two` minimises the 2-norm, `one` is the interval that minimises the 1-norm (both ends equal if it is a point),
    `maximum` minimises the maximum norm.
    """

    two: float
    one: tuple[float, float]
    maximum: float


def mass_by_norm(middle: Array, pattern: Array) -> MassByNorm:
    """Return the masses from middle levels [N] and forces that hold one kilogram [N/kg], both (n,) or of equal shape.

    The middle level is the mean of the forces of the forward and backward lines at velocity zero: middle = m pattern +
    (fc+ - fc-)/2, with the magnitudes fc+ and fc- of Coulomb friction; the asymmetry (fc+ - fc-)/2 is the residual. The
    2-norm gives m = middle.pattern / pattern.pattern. Raises ArgumentError for unequal shapes, numbers that are not
    finite, and a pattern of zeros.

    >>> pattern = np.array([-7.9, -0.7, 8.6])
    >>> masses = gt.identify.mass_by_norm(20.0 * pattern + np.array([10.0, 0.0, 0.0]), pattern)
    >>> round(masses.two, 2), round(masses.one[0], 2), round(masses.maximum, 2)  # the 1-norm leaves an outlier alone
    (19.42, 20.0, 19.39)
    """
    c, g = np.asarray(middle, float), np.asarray(pattern, float)
    if c.shape != g.shape:
        raise ArgumentError(f"has the shape {c.shape}; expected the shape of the pattern, {g.shape}", "middle")
    if not (np.isfinite(c).all() and np.isfinite(g).all()):
        raise ArgumentError("middle or pattern has a number that is not finite", "middle")
    if not np.any(g):
        raise ArgumentError(NO_LOAD, "pattern")
    c, g = c.ravel(), g.ravel()
    return MassByNorm(float(c @ g / (g @ g)), _weighted_median(c, g), _minimax(c, g))


def _weighted_median(c: Array, g: Array) -> tuple[float, float]:
    """The median of c/g with weights |g|, which minimises sum |c - m g| = sum |g| |c/g - m|; an interval at a tie."""
    c, g = c[g != 0], g[g != 0]
    order = np.argsort(c / g)
    ratios, weight = (c / g)[order], np.abs(g)[order]
    share = np.cumsum(weight) / weight.sum()
    k = int(np.searchsorted(share, 0.5 - TIE))
    return float(ratios[k]), float(ratios[k + 1] if abs(share[k] - 0.5) <= TIE else ratios[k])


def _minimax(c: Array, g: Array) -> float:
    """Least e with -e <= c - m g <= e, as a linear program in (m, e)."""
    ones = np.ones_like(g)
    upper = np.vstack([np.column_stack([-g, -ones]), np.column_stack([g, -ones])])
    optimum = scipy.optimize.linprog([0, 1], A_ub=upper, b_ub=np.concatenate([-c, c]), bounds=[(None, None), (0, None)])
    return float(optimum.x[0])
