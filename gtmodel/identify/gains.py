"""Gains of the drives, estimated together with the parameters, and known payloads that make them identifiable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..lang import ModelError
from ..results import ArgumentError
from ..robots import SerialArm
from ..robots.serial.structure import with_payload
from .base_parameters import parameters_of
from .inertia import Identification
from .regressor import Regressor
from .rows import Rows

Array = np.ndarray

STEPS, STILL = 30, 1e-9  # Gauss-Newton steps, and the relative change of the gains at convergence


def with_payloads(rows: Rows, arm: SerialArm, regressor: Regressor, masses: Sequence[float]) -> Rows:
    """Return the rows with the efforts of a known point mass [kg] at the tool's origin in each recording.

    regressor: of the rows; bodies of the last link that it does not contain cannot be loaded. Raises ArgumentError.
    """
    bodies = {name: np.array(getattr(arm, name), float) for name in ("m", "mc", "J")}
    tool = {"tool_xyz": np.asarray(arm.tool_xyz, float)}
    empty = parameters_of(arm)
    y0 = rows.y0.copy()
    ends = [*rows.starts, len(rows)]
    for k, mass in enumerate(masses):
        loaded = with_payload({**bodies, **tool}, float(mass), len(arm.structure.joints))
        values = parameters_of(arm.with_(**{name: loaded[name] for name in bodies}))
        if not set(base_bodies(values)) <= set(getattr(regressor, "everything", regressor.names)):
            raise ArgumentError('needs inertias = "base" or "consistent"', "fitting.payloads")
        before, after = (np.array(list(regressor.numbers_of(v).values())) for v in (empty, values))
        part = slice(ends[k], ends[k + 1])
        y0[part] += rows.Y[part] @ (after - before)
    return replace(rows, y0=y0)


def base_bodies(values: dict[str, float]) -> list[str]:
    """Names of the bodies' parameters."""
    return [n for n in values if n.startswith(("m[", "mc[", "J["))]


def with_gains(rows: Rows, signal: str, parameters: Array, gains: Array) -> Rows:
    """Return the rows with the gain of each effort as a further parameter, linear about these values.

    The measured effort is (Y p + y0) / gain: with a gain of 1.1 the drive gives a tenth more than its reading says.
    parameters (p,), gains (m,): where the rows are exact. The new parameters have the names of a free scale, such as
    "tau.scale[1]".
    """
    m, p = len(rows.targets), len(rows.names)
    modelled = rows.Y @ parameters + rows.y0
    slope = -modelled / gains**2
    columns = slope[:, :, None] * np.eye(m)
    names = tuple(f"{signal}.scale{f'[{k}]' if m > 1 else ''}" for k in range(m))
    assert p == len(parameters)
    return replace(
        rows,
        names=(*rows.names, *names),
        nominal=np.concatenate([rows.nominal, np.ones(m)]),
        units=(*rows.units, *["1"] * m),
        Y=np.concatenate([rows.Y / gains[:, None], columns], axis=2),
        y0=rows.y0 / gains - slope * gains,
        signed=(*rows.signed, *names),
    )


def fit_with_gains(
    rows: Rows,
    prepared: Callable[[Rows, tuple[Array, Array] | None], Rows],
    fit: Callable[[Rows], Identification],
) -> tuple[Identification, tuple[Array, Array]]:
    """Fit parameters and gains by Gauss-Newton steps; return the fit, linear about its optimum, and this optimum.

    Args:
        rows: without gains.
        prepared: the rows to fit, with gains and what else is free, about parameters and gains; without gains for None.
        fit: the fit of these.

    Raises ModelError if no effort is known, and if a gain is not positive or the steps do not converge.
    """
    if not np.any(rows.y0):
        raise ModelError(
            "gains cannot be distinguished from masses, inertias and friction: all of them times two give the same "
            "readings. Record the motion with a known payload too (payloads), or give the gains"
        )
    m, p = len(rows.targets), len(rows.names)
    parameters, gains = fit(prepared(rows, None)).parameters[:p], np.ones(m)
    for _ in range(STEPS):
        found = fit(prepared(rows, (parameters, gains)))
        before, gains = gains, found.parameters[p : p + m]
        parameters = found.parameters[:p]
        if not np.all(gains > 0):
            n = int(np.argmin(gains))
            raise ModelError(
                f"the gain of {rows.targets[n]} would be {gains[n]:.3g}: check the sign of this effort and of its "
                "position, and that the payload loads this joint"
            )
        if np.max(np.abs(gains - before)) <= STILL:
            return found, (parameters, gains)
    raise ModelError(
        f"the gains do not converge in {STEPS} steps: check that the payload loads every joint, and that gear ratio and "
        "motor constant are those of the data sheet"
    )
