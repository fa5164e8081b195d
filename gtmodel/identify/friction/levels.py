"""Friction of each actuator and the weight they hold, from runs at constant velocity (Dressler 2012, section 6.2), with
checks that the friction is physical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...inference import FALSE_ALARM, linear_fit
from ...inference.covariance import carried
from ...measurements.inspection.data_tests import Data, tested
from ...results import ArgumentError, Estimate
from ...results.refusal import renamed
from ...results.suspicion import Inspection, Suspicion
from ...results.trajectory_checks import Array
from ..checks import columns_compared, leaves
from .constant_velocity import Runs
from .gravity import NO_LOAD, PARALLEL, Gravity, MassByNorm, mass_by_norm
from .options import FrictionAlarm


def check(runs: Runs, pattern: Array, inspection: Inspection) -> None:
    """Raises ArgumentError for wrong shapes, numbers that are not finite, and copies that are not accepted."""
    poses, carts = pattern.shape
    for name, part in (("velocities", runs.velocity), ("forces", runs.force)):
        if part.ndim != 2 or part.shape[1] != carts or len(part) != len(runs.pose):
            raise ArgumentError(
                f"the {name} have the shape {part.shape}; expected one row for each of {len(runs.pose)} runs and one "
                f"column for each of {carts} carts",
                "runs",
            )
        if not np.all(np.isfinite(part)):
            run, cart = np.argwhere(~np.isfinite(part))[0]
            raise ArgumentError(
                f"run {run + 1} of cart {cart + 1} has a value among the {name} that is not finite; leave it out",
                "runs",
            )
    if not np.any(pattern):
        raise ArgumentError(NO_LOAD, "pattern")
    if np.any((runs.pose < 0) | (runs.pose >= poses)):
        raise ArgumentError(f"a run has pose {int(np.max(runs.pose)) + 1}; the pattern has {poses} poses", "runs")
    columns = {"velocity": runs.velocity, "force": runs.force, "position": runs.position}
    for suspicion in tested(Data(columns, ["force"], "run")):
        inspection.refuse(suspicion, "runs")


def refuse_exchanged(runs: Runs, pattern: Array, symmetric: bool, inspection: Inspection) -> bool:
    """Raises ArgumentError, unless accepted, if the forces in another order of columns, or with one sign reversed, fit
    motion and gravity far better; False if the data cannot decide."""
    count, carts = runs.force.shape
    bases = []
    for v in runs.velocity.T:
        forth, back = v > 0, v < 0
        columns = [np.sign(v), v] if symmetric else [forth, back, np.where(forth, v, 0.0), np.where(back, v, 0.0)]
        bases.append(np.linalg.qr(np.column_stack(columns).astype(float))[0])

    def without_friction(x: Array) -> Array:
        return np.concatenate([x[:, i] - Q @ (Q.T @ x[:, i]) for i, Q in enumerate(bases)])

    gravity = without_friction(pattern[runs.pose])
    mass_determined = float(gravity @ gravity) > PARALLEL * float(np.sum(pattern[runs.pose] ** 2))

    def squares_of(force: Array) -> float:
        f = without_friction(force)
        return float(f @ f - ((f @ gravity) ** 2 / (gravity @ gravity) if mass_determined else 0.0))

    degrees_of_freedom = count * carts - sum(Q.shape[1] for Q in bases) - int(mass_determined)
    names = [f"force {k + 1}" for k in range(carts)]
    comparison = columns_compared(names, runs.force, squares_of, degrees_of_freedom)
    if comparison is None:
        return True
    suspicion = replace(leaves(comparison, "N"), remedy="check order and signs of the columns")
    inspection.refuse(suspicion, "runs")
    return comparison.decisive


def refuse_driving(runs: Runs, estimate: Estimate, carts: int, symmetric: bool, inspection: Inspection) -> None:
    """Raises ArgumentError, unless accepted, if friction drives beyond the noise."""
    level = 1 - 2 * FALSE_ALARM / (2 * carts + 1)
    for cart in range(carts):
        speeds = np.abs(runs.velocity[:, cart])
        for v in (float(speeds.min()), float(speeds.max())):
            # the sum of both directions: gravity, and with it the mass, cancels
            weights = {f"coulomb_plus[{cart}]": 1.0, f"coulomb_minus[{cart}]": 1.0}
            weights |= {f"viscous_plus[{cart}]": v, f"viscous_minus[{cart}]": v}
            if symmetric:
                weights = {f"coulomb_plus[{cart}]": 2.0, f"viscous_plus[{cart}]": 2 * v}
            value, _, high = estimate.combination(weights, level)
            if high < 0:
                drives = f"cart {cart + 1}: friction would drive it instead of braking it, by {-value / 2:.3g} N at"
                look = "check the sign of this force or of its position, and the order of the columns"
                inspection.refuse(Suspicion("driving_friction", f"{drives} {v:.3g} m/s", remedy=look), "runs")


def refuse_no_mass(estimate: Estimate, carts: int, symmetric: bool, gravity: Gravity, inspection: Inspection) -> None:
    """Raises ArgumentError, unless accepted, if the mass is negative beyond the noise."""
    level = 1 - 2 * FALSE_ALARM / (2 * carts + 1)
    mass, high = estimate.value("m"), estimate.interval("m", level)[1]
    if high < 0:
        why = "check the direction of gravity and the sign of the guideways, the poses and the order of the columns"
        if gravity == "most_symmetric" and not symmetric:
            why += '; if friction differs by direction more than gravity does, let poses determine the mass ("poses")'
        evidence = f"the mass would be negative, {mass:.4g} kg"
        inspection.refuse(Suspicion("negative_mass", evidence, remedy=why), "pattern")


COLUMNS = (
    "a force in another cart's column, or with another sign, would fit these runs as well: only the order of columns "
    "in the log decides"
)


@dataclass(frozen=True)
class FrictionFit:
    """Friction by actuator and direction, and the mass.

    `coulomb_plus` and `coulomb_minus` (carts,) [N], both positive, with `viscous_plus` and `viscous_minus` (carts,)
    [kg/s]: tau = m pattern + fc+ + fv+ v forwards and m pattern - fc- + fv- v backwards, v < 0. `mass` is m [kg].
    `estimate` has all of these with their covariance, named "m", "coulomb_plus[0]" and so on. `lines` are the fitted
    straight lines by actuator; `middle` (poses, carts) the levels midway between the two directions [N]; `pattern`
    (poses, carts) the forces that hold one kilogram [N/kg]; `by_norm` the mass by three norms; `notes` say what the
    runs do not determine; `residual_rms` (carts,) is the rms residual of the lines [N].
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
    notes: tuple[str, ...]
    residual_rms: Array

    def against_motion(self, runs: Runs, level: float) -> tuple[float, float]:
        """Least friction force [N] against the motion, and the upper limit of its confidence interval.

        It belongs to the cart, direction and speed with the least upper limit; a negative limit means that friction
        drives.
        """
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
    runs: Runs,
    pattern: Array,
    *,
    symmetric: bool = False,
    gravity: Gravity = "most_symmetric",
    accept: Sequence[FrictionAlarm] = (),
) -> FrictionFit:
    """Identify friction of each actuator and the mass they hold from constant-velocity runs (Dressler 2012, eq. (6.9)).

    Args:
        runs: velocities and mean forces.
        pattern: (poses, carts) force of each cart that holds one kilogram [N/kg], from the geometry.
        symmetric: one Coulomb and one viscous coefficient for both directions.
        gravity: how the mass is found if friction may differ by direction. "most_symmetric": minimise the sum of
            squares of the asymmetry of the middle levels, as the thesis did by eye. "poses": from the change of the
            levels between poses, with the same friction in all; it needs poses of different patterns.
        accept: alarms about runs and columns that become notes instead of errors.

    Each actuator's line is a separate least-squares fit with its own noise; the rest is a linear function of the lines.
    Raises ArgumentError if a direction has too few velocities, if poses do not determine the mass, if runs are copies,
    if forces in other columns or with another sign fit far better, and, beyond the noise, if friction adds energy or
    the mass is negative.

    >>> velocity = np.array([[0.2], [0.6], [1.0], [-0.2], [-0.6], [-1.0]])  # one cart, m/s
    >>> force = np.array([[180.0], [257.0], [330.0], [-95.0], [-159.0], [-224.0]])  # N
    >>> runs = gt.identify.Runs(velocity, force, np.zeros(6, int), np.ones(6), np.zeros((6, 1)))
    >>> fit = gt.identify.identify_friction(runs, np.array([[1.0]]))
    >>> fit.coulomb_plus.round(), fit.viscous_plus.round(), fit.viscous_minus.round()
    (array([103.]), array([187.]), array([161.]))
    """
    pattern = np.atleast_2d(np.asarray(pattern, dtype=float))
    poses, carts = pattern.shape
    if "copied_runs" in accept:
        renamed("the alarm copied_runs", "copied_rows")
        accept = [*accept, "copied_rows"]
    inspection = Inspection(accept)
    check(runs, pattern, inspection)
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
    coefficients = dict(zip(rows, T @ values, strict=True))
    residuals = np.concatenate([line.residuals for line in lines])
    degrees_of_freedom = min(line.degrees_of_freedom for line in lines)
    estimate = Estimate(
        tuple(rows), T @ values, carried(T, covariance), degrees_of_freedom, float(np.sqrt(np.mean(residuals**2))),
        False, residuals, (), units=tuple({"m": "kg", "c": "N", "v": "kg/s"}[name[0]] for name in rows),
    )  # fmt: skip

    residuals_by_cart = np.column_stack([line.residuals for line in lines])
    for suspicion in tested(Data(residuals=residuals_by_cart, row="run")):
        inspection.refuse(suspicion, "runs")
    refuse_driving(runs, estimate, carts, symmetric, inspection)
    columns_certain = refuse_exchanged(runs, pattern, symmetric, inspection)
    refuse_no_mass(estimate, carts, symmetric, gravity, inspection)

    def by_cart(name: str) -> Array:
        return np.array([coefficients[f"{name}[{i}]"] for i in range(carts)])

    levels = middle @ values
    return FrictionFit(
        float(coefficients["m"]),
        by_cart("coulomb_plus"),
        by_cart("coulomb_minus"),
        by_cart("viscous_plus"),
        by_cart("viscous_minus"),
        estimate,
        lines,
        levels,
        pattern,
        mass_by_norm(levels, pattern),
        (
            *_open_questions(pattern, symmetric, gravity),
            *([] if columns_certain or symmetric else [COLUMNS]),
            *inspection.notes,
        ),
        np.array([np.sqrt(np.mean(line.residuals**2)) for line in lines]),
    )


def _line(runs: Runs, cart: int, poses: int, symmetric: bool) -> Estimate:
    """Levels by pose and viscous coefficients of one actuator.

    Names: "plus 0", "minus 0", .. "viscous plus", "viscous minus"; symmetric: "middle 0", .., "coulomb", "viscous".
    """
    v, tau = runs.velocity[:, cart], runs.force[:, cart]
    columns: dict[str, Array] = {}
    for p in range(poses):
        for sign, way in ((1, "plus"), (-1, "minus")):
            selected = (runs.pose == p) & (np.sign(v) == sign)
            speeds = np.unique(np.round(np.abs(v[selected]), 9))
            if speeds.size < (1 if symmetric or p else 2):
                raise ArgumentError(
                    f"cart {cart + 1}, pose {p + 1}: {speeds.size} velocities in direction {way}; expected at least "
                    "two for a level and a slope",
                    "runs",
                )
            if not symmetric:
                columns[f"{way} {p}"] = selected.astype(float)
        if symmetric:
            columns[f"middle {p}"] = (runs.pose == p).astype(float)
    if symmetric:
        columns |= {"coulomb": np.sign(v), "viscous": v}
    else:
        columns |= {"viscous plus": np.where(v > 0, v, 0.0), "viscous minus": np.where(v < 0, v, 0.0)}
    try:
        return linear_fit(np.column_stack(list(columns.values())), tau, list(columns))
    except ValueError as error:
        raise ArgumentError(f"cart {cart + 1}: {error}", "runs") from error


def _mass_weights(pattern: Array, gravity: Gravity, symmetric: bool) -> Array:
    """(poses, carts): weights of the middle levels in the mass."""
    if gravity == "most_symmetric" or symmetric:
        return pattern / np.sum(pattern**2)
    change = pattern - pattern.mean(axis=0)
    if np.sum(change**2) <= PARALLEL * np.sum(pattern**2):
        raise ArgumentError(
            "gravity loads the actuators alike in all poses, so that their levels do not determine the mass; record "
            "another pose, or use the most symmetric friction",
            "pattern",
        )
    return change / np.sum(change**2)


def _open_questions(pattern: Array, symmetric: bool, gravity: Gravity) -> tuple[str, ...]:
    if symmetric:
        return (
            "the runs determine everything, provided that friction is the same in both directions; they cannot "
            "distinguish a difference from a gravity that differs from the geometry's",
        )
    alone = (
        "the runs determine the slopes and the two levels of each actuator; its gravity and the asymmetric half of its "
        "Coulomb friction, (fc+ - fc-)/2, enter only as their sum and cannot be distinguished on one actuator"
    )
    if gravity == "poses":
        return (
            alone,
            "the change of the levels between poses determines the mass, provided that friction does not change with "
            "the pose",
        )
    moves = ", ".join(f"{-g:+.2f}" for g in pattern.mean(axis=0))
    return (
        alone,
        f"one more kilogram would change fc+ by {moves} N on the actuators in order and fc- by the opposite, with the "
        "same forces: the mass is a choice, the one that makes friction most symmetric (2-norm), and its interval "
        "belongs to that choice",
    )
