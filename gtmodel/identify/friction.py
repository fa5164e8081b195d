"""Friction of each actuator, and the weight they hold, from runs at constant velocity (Dressler 2012, eq. (6.9))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..inference import FALSE_ALARM, linear_fit
from ..measurements.copies import SAME, copies
from ..results.estimate import Estimate
from ..results.trajectory_errors import Array
from .exchanged import exchanged
from .gravity import MassByNorm, mass_by_norm
from .steady import Runs

Gravity = Literal["most_symmetric", "poses"]
# patterns closer to parallel than this: the difference of gravity between poses tells no mass
PARALLEL = 1e-6
COLUMNS = (
    "some force in another cart's column, or with another sign, would fit these runs as well: only the log's own order "
    "says whose it is"
)
DIGITS, FEW = 6, 1e-12  # of a force that was written down, not a mean; how far the rounding of that is off


class FrictionError(ValueError):
    """Runs that do not determine what is asked. The message is one sentence."""


@dataclass(frozen=True)
class FrictionFit:
    """Friction by actuator and direction, and the mass.

    coulomb_plus, coulomb_minus (carts,) [N], viscous_plus, viscous_minus (carts,) [kg/s]: tau = m pattern + fc+ + fv+ v
    forwards and m pattern - fc- + fv- v backwards. mass [kg]. estimate : all of these with their covariance, named
    "m", "coulomb_plus[0]" and so on. lines : the straight lines by actuator, as fitted. middle (poses, carts): levels
    between the two directions [N]. by_norm : the mass by three norms. undetermined : in words. sizes of residuals
    (carts,) [N] rms.
    """

    mass: float
    coulomb_plus: Array
    coulomb_minus: Array
    viscous_plus: Array
    viscous_minus: Array
    estimate: Estimate
    lines: tuple[Estimate, ...]
    middle: Array
    pattern: Array
    by_norm: MassByNorm
    undetermined: tuple[str, ...]
    residual_rms: Array

    def against_motion(self, runs: Runs, level: float) -> tuple[float, float]:
        """Friction force [N] against the motion, of the cart, direction and speed where it is least beyond its noise,
        and the upper limit of its confidence interval: negative, it drives."""
        least = (np.inf, np.inf)
        for cart in range(len(self.lines)):
            for way, sign in (("plus", 1), ("minus", -1)):
                speeds = np.abs(runs.velocity[np.sign(runs.velocity[:, cart]) == sign, cart])
                for v in (float(speeds.min()), float(speeds.max())):
                    weights = {f"coulomb_{way}[{cart}]": 1.0, f"viscous_{way}[{cart}]": v}
                    value, _, high = self.estimate.combination(weights, level)
                    least = min(least, (value, high), key=lambda pair: pair[1])
        return least

    def force(self, velocity: Array, cart: int, pose: int = 0) -> Array:
        """Modelled force [N] of a cart at constant velocity [m/s], not zero."""
        v = np.asarray(velocity, dtype=float)
        forwards = self.coulomb_plus[cart] + self.viscous_plus[cart] * v
        backwards = -self.coulomb_minus[cart] + self.viscous_minus[cart] * v
        return self.mass * self.pattern[pose, cart] + np.where(v > 0, forwards, backwards)


def identify_friction(
    runs: Runs, pattern: Array, *, symmetric: bool = False, gravity: Gravity = "most_symmetric"
) -> FrictionFit:
    """Friction and mass from constant-velocity runs.

    Args:
        runs: velocities and mean forces.
        pattern: (poses, carts) force of each cart that holds one kilogram [N/kg], by the geometry.
        symmetric: one Coulomb and one viscous coefficient for both directions.
        gravity: how the mass is found while friction may differ by direction. "most_symmetric": the least sum of
            squares of what is left of the middle levels, as the thesis did by eye. "poses": from the change of the
            levels between poses, friction being the same in all; it needs poses of different patterns.

    Every actuator's line is a least-squares fit of its own, its noise its own; the rest is a linear function of the
    lines. Raises FrictionError where a direction has too few velocities, where poses do not tell the mass, where runs
    are copies of others, where forces in other columns or with another sign fit far better, and where no drive can be
    so: friction that gives energy, or a negative mass, beyond noise.
    """
    pattern = np.atleast_2d(np.asarray(pattern, dtype=float))
    poses, carts = pattern.shape
    _check(runs, pattern)
    lines = tuple(_line(runs, cart, poses, symmetric) for cart in range(carts))
    names = lines[0].names
    # all lines as one vector, actuator after actuator
    values = np.concatenate([line.values for line in lines])
    covariance = np.zeros((values.size, values.size))
    for cart, line in enumerate(lines):
        part = slice(cart * len(names), (cart + 1) * len(names))
        covariance[part, part] = line.covariance

    def row(name: str, cart: int) -> Array:
        unit = np.zeros(values.size)
        unit[cart * len(names) + names.index(name)] = 1.0
        return unit

    if symmetric:
        middle = np.array([[row(f"middle {p}", i) for i in range(carts)] for p in range(poses)])
    else:
        middle = np.array(
            [[(row(f"plus {p}", i) + row(f"minus {p}", i)) / 2 for i in range(carts)] for p in range(poses)]
        )
    mass = np.tensordot(_mass_weights(pattern, gravity, symmetric), middle, axes=2)
    rows = {"m": mass}
    for i in range(carts):
        weight = np.mean(pattern[:, i]) * mass
        for sign, way in ((1, "plus"), (-1, "minus")):
            name = "coulomb" if symmetric else ""
            level = np.mean([row(f"{way} {p}", i) for p in range(poses)], axis=0) if not symmetric else None
            rows[f"coulomb_{way}[{i}]"] = row(name, i) if level is None else sign * (level - weight)
            rows[f"viscous_{way}[{i}]"] = row("viscous" if symmetric else f"viscous {way}", i)
    T = np.array(list(rows.values()))
    found = dict(zip(rows, T @ values, strict=True))
    residuals = np.concatenate([line.residuals for line in lines])
    freedom = min(line.freedom for line in lines)
    estimate = Estimate(
        tuple(rows), T @ values, T @ covariance @ T.T, freedom, float(np.sqrt(np.mean(residuals**2))), False, residuals,
        (), units=tuple({"m": "kg", "c": "N", "v": "kg/s"}[name[0]] for name in rows),
    )  # fmt: skip

    _refuse_driving(runs, estimate, carts, symmetric)
    told = _refuse_exchanged(runs, pattern, symmetric)
    _refuse_no_mass(estimate, carts, symmetric, gravity)

    def each(name: str) -> Array:
        return np.array([found[f"{name}[{i}]"] for i in range(carts)])

    levels = middle @ values
    return FrictionFit(
        float(found["m"]),
        each("coulomb_plus"),
        each("coulomb_minus"),
        each("viscous_plus"),
        each("viscous_minus"),
        estimate,
        lines,
        levels,
        pattern,
        mass_by_norm(levels, pattern),
        (*_in_words(pattern, symmetric, gravity), *([] if told or symmetric else [COLUMNS])),
        np.array([np.sqrt(np.mean(line.residuals**2)) for line in lines]),
    )


def _line(runs: Runs, cart: int, poses: int, symmetric: bool) -> Estimate:
    """Levels by pose and slopes of one actuator. Names: "plus 0", "minus 0", .. "viscous plus", "viscous minus";
    symmetric: "middle 0", .., "coulomb", "viscous"."""
    v, tau = runs.velocity[:, cart], runs.force[:, cart]
    columns: dict[str, Array] = {}
    for p in range(poses):
        for sign, way in ((1, "plus"), (-1, "minus")):
            here = (runs.pose == p) & (np.sign(v) == sign)
            speeds = np.unique(np.round(np.abs(v[here]), 9))
            if speeds.size < (1 if symmetric or p else 2):
                raise FrictionError(
                    f"cart {cart + 1}, pose {p + 1}: {speeds.size} velocities in direction {way}; expected at least "
                    "two for a level and a slope"
                )
            if not symmetric:
                columns[f"{way} {p}"] = here.astype(float)
        if symmetric:
            columns[f"middle {p}"] = (runs.pose == p).astype(float)
    if symmetric:
        columns |= {"coulomb": np.sign(v), "viscous": v}
    else:
        columns |= {"viscous plus": np.where(v > 0, v, 0.0), "viscous minus": np.where(v < 0, v, 0.0)}
    try:
        return linear_fit(np.column_stack(list(columns.values())), tau, list(columns))
    except ValueError as error:
        raise FrictionError(f"cart {cart + 1}: {error}") from error


def _check(runs: Runs, pattern: Array) -> None:
    poses, carts = pattern.shape
    for name, part in (("velocities", runs.velocity), ("forces", runs.force)):
        if part.ndim != 2 or part.shape[1] != carts or len(part) != len(runs.pose):
            raise FrictionError(
                f"the {name} have the shape {part.shape}; expected one row for each of {len(runs.pose)} runs and one "
                f"column for each of {carts} carts"
            )
        if not np.all(np.isfinite(part)):
            run, cart = np.argwhere(~np.isfinite(part))[0]
            raise FrictionError(f"run {run + 1} of cart {cart + 1} has no finite number among the {name}; leave it out")
    if not np.any(pattern):
        raise FrictionError("one kilogram loads no cart, so no force tells the mass; check the direction of gravity")
    if np.any((runs.pose < 0) | (runs.pose >= poses)):
        raise FrictionError(f"a run names pose {int(np.max(runs.pose)) + 1}; the pattern has {poses}")
    pairs = _copies(runs)
    if len(pairs):
        again, first = pairs[0] + 1
        raise FrictionError(
            f"{len(pairs)} of {len(runs.pose)} runs are copies of others, run {again} of run {first} to begin with; "
            "noise does not repeat itself, and a copy counts twice and narrows the intervals: take copies out"
        )


def _copies(runs: Runs) -> np.ndarray:
    """Pairs of runs that are the same, also where positions of one were moved by a constant."""
    motion = np.column_stack([runs.velocity, runs.force])
    pairs = copies(np.column_stack([motion, runs.position]), SAME)
    if len(pairs):
        return pairs
    # a mean of noise has all digits; where forces are given in few, two runs may well agree
    fine = np.any(np.abs(runs.force - _rounded(runs.force)) > FEW * np.abs(runs.force), axis=1)
    rows = np.flatnonzero(fine)
    return rows[copies(motion[rows], SAME)] if len(rows) else pairs


def _rounded(values: Array) -> Array:
    size = 10.0 ** (np.floor(np.log10(np.maximum(np.abs(values), np.finfo(float).tiny))) - DIGITS + 1)
    return np.round(values / size) * size


def _refuse_exchanged(runs: Runs, pattern: Array, symmetric: bool) -> bool:
    """Raises FrictionError where the forces in another order of columns, or one of them reversed, follow motion and
    gravity far better; False where nothing tells."""
    count, carts = runs.force.shape
    bases = []
    for v in runs.velocity.T:
        forth, back = v > 0, v < 0
        columns = [np.sign(v), v] if symmetric else [forth, back, np.where(forth, v, 0.0), np.where(back, v, 0.0)]
        bases.append(np.linalg.qr(np.column_stack(columns).astype(float))[0])

    def without_friction(x: Array) -> Array:
        return np.concatenate([x[:, i] - Q @ (Q.T @ x[:, i]) for i, Q in enumerate(bases)])

    gravity = without_friction(pattern[runs.pose])
    told = float(gravity @ gravity) > PARALLEL * float(np.sum(pattern[runs.pose] ** 2))

    def left(order: list[int], signs: list[int]) -> float:
        f = without_friction(runs.force[:, order] * signs)
        return float(f @ f - ((f @ gravity) ** 2 / (gravity @ gravity) if told else 0.0))

    freedom = count * carts - sum(Q.shape[1] for Q in bases) - int(told)
    found = exchanged(left, carts, freedom, float(np.sqrt(np.mean(runs.force**2))))
    if found is not None and not found.passed:
        names = [f"force {k + 1}" for k in range(carts)]
        raise FrictionError(f"{found.sentence(names, 'N')}; check order and signs of the columns")
    return found is None or found.told


def _refuse_driving(runs: Runs, estimate: Estimate, carts: int, symmetric: bool) -> None:
    """Raises FrictionError for friction that drives beyond noise."""
    level = 1 - 2 * FALSE_ALARM / (2 * carts + 1)
    for cart in range(carts):
        speeds = np.abs(runs.velocity[:, cart])
        for v in (float(speeds.min()), float(speeds.max())):
            # forth and back: gravity, and with it the mass, falls out
            weights = {f"coulomb_plus[{cart}]": 1.0, f"coulomb_minus[{cart}]": 1.0}
            weights |= {f"viscous_plus[{cart}]": v, f"viscous_minus[{cart}]": v}
            if symmetric:
                weights = {f"coulomb_plus[{cart}]": 2.0, f"viscous_plus[{cart}]": 2 * v}
            value, _, high = estimate.combination(weights, level)
            if high < 0:
                raise FrictionError(
                    f"cart {cart + 1}: friction would drive it instead of braking it, by {-value / 2:.3g} N at "
                    f"{v:.3g} m/s; check the sign of this force or of its position, and the order of the columns"
                )


def _refuse_no_mass(estimate: Estimate, carts: int, symmetric: bool, gravity: Gravity) -> None:
    """Raises FrictionError for a mass that is negative beyond noise."""
    level = 1 - 2 * FALSE_ALARM / (2 * carts + 1)
    mass, high = estimate.value("m"), estimate.interval("m", level)[1]
    if high < 0:
        why = "check the direction of gravity and the sign of the guideways, the poses and the order of the columns"
        if gravity == "most_symmetric" and not symmetric:
            why += '; or friction differs by direction more than gravity does, then let poses tell the mass ("poses")'
        raise FrictionError(f"the mass would be {mass:.4g} kg, which none can be; {why}")


def _mass_weights(pattern: Array, gravity: Gravity, symmetric: bool) -> Array:
    """(poses, carts): the mass as a linear function of the middle levels."""
    if gravity == "most_symmetric" or symmetric:
        return pattern / np.sum(pattern**2)
    change = pattern - pattern.mean(axis=0)
    if np.sum(change**2) <= PARALLEL * np.sum(pattern**2):
        raise FrictionError(
            "gravity loads the actuators alike in all poses, so their levels do not tell the mass; record another "
            "pose, or take the most symmetric friction"
        )
    return change / np.sum(change**2)


def _in_words(pattern: Array, symmetric: bool, gravity: Gravity) -> tuple[str, ...]:
    if symmetric:
        return (
            "nothing is left open, given that friction is the same in both directions; whether it is, these runs "
            "cannot tell from a gravity that differs from the geometry's",
        )
    alone = (
        "slopes and the two levels of each actuator are determined; its gravity and the asymmetric half of its Coulomb "
        "friction, (fc+ - fc-)/2, enter only as their sum and cannot be told apart on one actuator"
    )
    if gravity == "poses":
        return (
            alone,
            "the mass is told by how the levels change between poses, as far as friction itself does not change with "
            "the pose",
        )
    moves = ", ".join(f"{-g:+.2f}" for g in pattern.mean(axis=0))
    return (
        alone,
        f"one kilogram more would change fc+ by {moves} N on the actuators in turn and fc- by the opposite, with the "
        "same forces: the mass is a choice, the one that makes friction most symmetric (2-norm), and its interval is "
        "that choice's, not the mass's",
    )
