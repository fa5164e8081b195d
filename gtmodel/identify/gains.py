"""Gains of the drives, estimated together with the parameters, and known payloads that make them identifiable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..geometry.rotations import rotation_of_rpy
from ..lang import ModelError
from ..measurements import ESTIMATE, Signal
from ..results import ArgumentError, TrajectoryError
from ..robots import SerialArm
from ..robots.serial.structure import with_payload
from .inertia import Identification
from .options import Fitting
from .regressor import Regressor
from .rows import Rows

Array = np.ndarray

STEPS, STILL = 30, 1e-9  # Gauss-Newton steps, and the change of the gains at convergence


def check_payloads(how: Fitting, bodies: bool, count: int, held_out: int) -> None:
    """Raises ArgumentError unless there is one payload for each recording, and the bodies of an arm are estimated."""
    if how.payloads is None:
        return
    if not bodies:
        raise ArgumentError('needs a serial arm, and inertias = "base" or "consistent"', "fitting.payloads")
    if len(how.payloads) not in (count, count + held_out):
        more = f", or {count + held_out} with those of the held-out ones" if held_out else ""
        raise ArgumentError(
            f"has {len(how.payloads)} masses; expected {count}, one for each recording{more}", "fitting.payloads"
        )


def by_data_sheet(signals: Mapping[str, Signal], targets: str, loaded: bool) -> tuple[dict[str, Signal], bool]:
    """Return the signals with the efforts scaled by the data sheet alone, and whether a gain is to be estimated.

    loaded: whether a recording has a payload. Raises ArgumentError if other corrections are to be estimated too.
    """
    gains = signals[targets].scale == ESTIMATE
    more = [n for n, s in signals.items() if ESTIMATE in (s.delay, *([s.scale, s.offset] if n != targets else []))]
    if (gains or loaded) and more:
        what = "a scale of the efforts" if gains else "payloads"
        raise ArgumentError(f"an estimate of '{more[0]}' cannot be combined with {what}; give a number", "log")
    if not gains:
        return dict(signals), False
    try:
        return {**signals, targets: replace(signals[targets], scale=1.0)}, True
    except TrajectoryError as error:
        raise ArgumentError(
            f"the scale of '{targets}' is estimated relative to the data sheet: give gear ratio and motor constant",
            "log",
        ) from error


def with_payloads(
    rows: Rows, arm: SerialArm, regressor: Regressor, masses: Sequence[float], centre: Sequence[float]
) -> Rows:
    """Return the rows with the efforts of a known point mass [kg] in each recording.

    arm, regressor: of the rows, with base parameters. centre: of the masses in the tool frame (3,) [m].
    """
    from .base_parameters import parameters_of  # here: only arms have payloads

    point = np.asarray(arm.tool_xyz, float) + rotation_of_rpy(arm.tool_rpy) @ np.asarray(centre, float)
    bodies = {name: np.array(getattr(arm, name), float) for name in ("m", "mc", "J")}
    empty = regressor.numbers_of(parameters_of(arm))
    y0, ends = rows.y0.copy(), [*rows.starts, len(rows)]
    for k, mass in enumerate(masses):
        with_mass = with_payload({**bodies, "tool_xyz": point}, float(mass), len(arm.structure.joints))
        loaded = regressor.numbers_of(parameters_of(arm.with_(**{name: with_mass[name] for name in bodies})))
        part = slice(ends[k], ends[k + 1])
        y0[part] += rows.Y[part] @ np.array([loaded[n] - empty[n] for n in rows.names])
    return replace(rows, y0=y0)


def with_gains(rows: Rows, signal: str, parameters: Array, gains: Array, *, free: bool = True) -> Rows:
    """Return the rows with the gain of each effort as a further parameter, linear about these values.

    The measured effort is (Y p + y0) / gain: with a gain of 1.1 the drive gives a tenth more than its reading says.
    parameters (p,), gains (m,): the values about which the rows are linear. The new parameters have the names of a free
    scale, such as "tau.scale[1]". If they are not free, a fit can test whether the residuals contain their effect.
    """
    m = len(rows.targets)
    slope = -(rows.Y @ parameters + rows.y0) / gains**2
    names = tuple(f"{signal}.scale{f'[{k}]' if m > 1 else ''}" for k in range(m))
    return replace(
        rows,
        names=(*rows.names, *names),
        nominal=np.concatenate([rows.nominal, np.ones(m)]),
        units=(*rows.units, *["1"] * m),
        Y=np.concatenate([rows.Y / gains[:, None], slope[:, :, None] * np.eye(m)], axis=2),
        y0=rows.y0 / gains - slope * gains,
        signed=(*rows.signed, *names) if free else rows.signed,
    )


def fit_with_gains(
    rows: Rows,
    prepared: Callable[[Rows, tuple[Array, Array] | None], Rows],
    fit: Callable[[Rows], Identification],
    *,
    known: bool = True,
) -> tuple[Identification, tuple[Array, Array]]:
    """Fit parameters and gains by Gauss-Newton steps; return the fit, linear about its optimum, and this optimum.

    Args:
        rows: without gains.
        prepared: the rows to fit, linear about parameters and gains; without gains for None.
        fit: the fit of these.
        known: whether a part of the efforts is known, such as that of a payload.

    Raises ModelError if no effort is known, if a gain would not be positive, and if the steps do not converge.
    """
    if not known:
        raise ModelError(
            "the scale of the efforts cannot be distinguished from masses, inertias and friction: twice the scale and "
            "twice all of them give the same readings. Record a motion with a known payload too and give payloads, or "
            "give the scale"
        )
    m, p = len(rows.targets), len(rows.names)
    parameters, gains = fit(prepared(rows, None)).parameters[:p], np.ones(m)
    for _ in range(STEPS):
        identification = fit(prepared(rows, (parameters, gains)))
        before, gains = gains, identification.parameters[p : p + m]
        parameters = identification.parameters[:p]
        if not np.all(gains > 0):
            n = int(np.argmin(gains))
            raise ModelError(
                f"the scale of {rows.targets[n]} would be {gains[n]:.3g}: check the sign of this effort and of its "
                "position, and that the payload loads this joint"
            )
        if np.max(np.abs(gains - before)) <= STILL:
            return identification, (parameters, gains)
    raise ModelError(
        f"the scales of the efforts do not converge in {STEPS} steps: check that the payload loads every joint, and "
        "that gear ratio and motor constant are those of the data sheet"
    )
