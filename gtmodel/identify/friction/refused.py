"""What friction cannot be: runs that are copies, exchanged or reversed columns, drives that push, negative masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...inference import FALSE_ALARM
from ...measurements.inspection.data_tests import Data, tested
from ...results import ArgumentError, Estimate
from ...results.suspicion import Inspection, Suspicion
from ...results.trajectory_errors import Array
from ..exchanged import columns_compared, leaves
from .constant_velocity import Runs
from .gravity import PARALLEL, Gravity


def check(runs: Runs, pattern: Array, inspection: Inspection) -> None:
    """Raises ArgumentError for runs of other shapes and without numbers, and for copies that are not accepted."""
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
                f"run {run + 1} of cart {cart + 1} has no finite number among the {name}; leave it out", "runs"
            )
    if not np.any(pattern):
        raise ArgumentError(
            "one kilogram loads no cart, so no force determines the mass; check the direction of gravity", "pattern"
        )
    if np.any((runs.pose < 0) | (runs.pose >= poses)):
        raise ArgumentError(f"a run names pose {int(np.max(runs.pose)) + 1}; the pattern has {poses}", "runs")
    columns = {"velocity": runs.velocity, "force": runs.force, "position": runs.position}
    for suspicion in tested(Data(columns, ["force"], "run")):
        inspection.refuse(suspicion, "runs")


def refuse_exchanged(runs: Runs, pattern: Array, symmetric: bool, inspection: Inspection) -> bool:
    """Raises ArgumentError, unless that is accepted, where the forces in another order of columns, or one of them
    reversed, follow motion and gravity far better; False where nothing decides."""
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

    def left(force: Array) -> float:
        f = without_friction(force)
        return float(f @ f - ((f @ gravity) ** 2 / (gravity @ gravity) if mass_determined else 0.0))

    degrees_of_freedom = count * carts - sum(Q.shape[1] for Q in bases) - int(mass_determined)
    names = [f"force {k + 1}" for k in range(carts)]
    comparison = columns_compared(names, runs.force, left, degrees_of_freedom)
    if comparison is None:
        return True
    suspicion = replace(leaves(comparison, "N"), remedy="check order and signs of the columns")
    inspection.refuse(suspicion, "runs")
    return comparison.decisive


def refuse_driving(runs: Runs, estimate: Estimate, carts: int, symmetric: bool, inspection: Inspection) -> None:
    """Raises ArgumentError, unless that is accepted, for friction that drives beyond noise."""
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
                drives = f"cart {cart + 1}: friction would drive it instead of braking it, by {-value / 2:.3g} N at"
                look = "check the sign of this force or of its position, and the order of the columns"
                inspection.refuse(Suspicion("driving_friction", f"{drives} {v:.3g} m/s", remedy=look), "runs")


def refuse_no_mass(estimate: Estimate, carts: int, symmetric: bool, gravity: Gravity, inspection: Inspection) -> None:
    """Raises ArgumentError, unless that is accepted, for a mass that is negative beyond noise."""
    level = 1 - 2 * FALSE_ALARM / (2 * carts + 1)
    mass, high = estimate.value("m"), estimate.interval("m", level)[1]
    if high < 0:
        why = "check the direction of gravity and the sign of the guideways, the poses and the order of the columns"
        if gravity == "most_symmetric" and not symmetric:
            why += (
                '; or friction differs by direction more than gravity does, then let poses determine the mass ("poses")'
            )
        evidence = f"the mass would be {mass:.4g} kg, which none can be"
        inspection.refuse(Suspicion("negative_mass", evidence, remedy=why), "pattern")
