"""Masses and friction from motion: weighted least squares with bounds, covariance and tests of the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from gtmodel.inference import (
    FALSE_ALARM,
    HeldOut,
    Identifiability,
    Verdict,
    correlation_time,
    freedom_of,
    held_out_ratio,
    identifiability,
    linear_fit,
    newey_west,
    nominal_sizes,
    whiteness,
)
from gtmodel.inference.chance import f_chance, f_test
from gtmodel.inference.covariance import larger
from gtmodel.lang import ModelError
from gtmodel.results.estimate import Estimate

from .delay import Delay, delay_of
from .regressor import among
from .rows import Rows

Array = np.ndarray
Confidence = Literal["auto", "white", "newey_west"]

WEIGHTINGS = 2  # rounds of estimating the noise and fitting; a third round changes no printed digit


@dataclass(frozen=True, eq=False)
class LeftOut:
    """F test for omitted parameters: whether the residuals contain what a group of fixed parameters would explain.

    `names` are the parameters of the group; `tests` is the number of groups tested together, which share the false
    alarms.
    """

    names: tuple[str, ...]
    F: float
    p: float
    tests: int = 1

    @property
    def passed(self) -> bool:
        return self.p >= FALSE_ALARM / self.tests

    @property
    def message(self) -> str:
        names = ", ".join(self.names)
        if self.passed:
            return f"the residuals show no effect of {names} (F = {self.F:.3g}, p = {self.p:.2g})"
        advice = "estimate the scale of the efforts" if ".scale" in names else "free these too"
        return (
            f"the residuals show an effect of {names} (F = {self.F:.3g}, p = {self.p:.2g}), which also biases the free "
            f"parameters; {advice}"
        )


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified model.

    `rows` are the n fitted rows with m targets; `fixed` are the parameters at their nominal values. `estimate` has
    values, covariance and intervals [SI]; `estimate.held` are the parameters at a bound. `unbounded` is the fit without
    bounds (the same object if no bound is active). `residuals` (n, m) are measured minus modelled efforts; `noise` (m,)
    is their standard deviation by target. `whiteness` has one verdict per target. `confidence` is the assumption of the
    covariance, "white" or "newey_west". `identifiability` belongs to the scaled, weighted regressor; `left_out` holds
    the tests of the fixed parameters.
    """

    rows: Rows
    fixed: dict[str, float]
    estimate: Estimate
    unbounded: Estimate
    noise: Array
    residuals: Array
    whiteness: tuple[Verdict, ...]
    confidence: str
    identifiability: Identifiability
    left_out: tuple[LeftOut, ...]

    @property
    def parameters(self) -> Array:
        """Values (p,) of all parameters of the rows, fixed ones included."""
        return np.array(
            [self.fixed[n] if n in self.fixed else self.estimate.value(n) for n in self.rows.names], dtype=float
        )

    @property
    def numbers(self) -> dict[str, float]:
        """Estimates of model parameters by name, in the order of the rows; those at a bound included."""
        known = {*self.estimate.names, *self.estimate.held} - {*self.rows.signed}
        return {n: self.estimate.value(n) for n in self.rows.names if n in known}

    def modelled(self, rows: Rows | None = None) -> Array:
        """Modelled efforts (n, m) of these or other rows (Dressler 2012, Figs. 6.5 and 6.6)."""
        rows = self.rows if rows is None else rows
        return rows.Y @ self.parameters + rows.y0

    def validate(self, rows: Rows) -> Validation:
        """Errors on the rows of a held-out motion. Raises ModelError if the rows come from another regressor."""
        if rows.names != self.rows.names:
            raise ModelError("the rows come from another regressor; use the regressor of the fit")
        return Validation(rows, rows.effort - self.modelled(rows), self.noise, self._judged(rows))

    def _judged(self, rows: Rows) -> tuple[HeldOut, ...]:
        """Held-out rms error over the noise of the fit, by target, against what a correct model would have."""
        e = self.estimate
        free = [rows.names.index(n) for n in e.names]
        errors, m = rows.effort - self.modelled(rows), len(rows.targets)
        ratios = []
        for t, (noise, residuals) in enumerate(zip(self.noise, self.residuals.T, strict=True)):
            Y = rows.Y[:, t, free] / noise
            # what the parameter errors add to the noise of each row, in units of that noise
            CM = e.covariance @ (Y.T @ Y)
            n, extra, squared = len(Y), float(np.trace(CM)), float(np.trace(CM @ CM))
            correlated = correlation_time(residuals)
            ratios.append(
                held_out_ratio(
                    float(np.sqrt(np.mean(errors[:, t] ** 2)) / noise),
                    1 + extra / n,
                    max(len(residuals) - len(e.names) / m, 0.0) / correlated,
                    freedom_of(n + extra, n * correlated + 2 * extra + squared),
                    tests=m,
                )
            )
        return tuple(ratios)

    @cached_property
    def delay(self) -> Delay | None:
        """Delay between efforts and positions, see `delay_of`; None if the fit estimates delays itself."""
        return None if any(".delay" in name for name in self.rows.signed) else delay_of(self)

    @property
    def notes(self) -> list[str]:
        """Notes that qualify the estimates."""
        lines = [
            f"{n} is at its bound, 0; without the bound it would be {self.unbounded.value(n):.3g}. It has no interval, "
            "and the others treat it as known; if it may be negative, leave it out of nonnegative"
            for n in self.estimate.held
        ]
        lines += list(self.estimate.notes)
        lines += [f"{t}: {v.message}" for t, v in zip(self.rows.targets, self.whiteness, strict=True) if not v.passed]
        lines += [t.message for t in self.left_out if not t.passed]
        if self.delay is not None and not self.delay.passed:
            lines.append(self.delay.message)
        limits = [(n, *self.estimate.interval(n)) for n in self.estimate.names]
        zero = [f"{n} ({low:.3g} to {high:.3g})" for n, low, high in limits if low <= 0 <= high]
        return lines + ([f"cannot be distinguished from zero: {', '.join(zero)}"] if zero else [])


@dataclass(frozen=True, eq=False)
class Validation:
    """Errors (n, m) on the `rows` of a held-out motion, measured minus modelled, with the `noise` (m,) of the fit.

    `judged` (m,): rms error over the noise of the fit, against what a correct model would have.
    """

    rows: Rows
    errors: Array
    noise: Array
    judged: tuple[HeldOut, ...]

    @property
    def rms(self) -> Array:
        """rms error of each target (m,), in the unit of the efforts."""
        return np.sqrt(np.mean(self.errors**2, axis=0))

    @property
    def relative(self) -> Array:
        """rms error over rms effort (m,)."""
        return self.rms / np.sqrt(np.mean(self.rows.effort**2, axis=0))

    @property
    def message(self) -> str:
        errors = ", ".join(
            f"{t} {e:.3g} ({100 * r:.2g} %, {e / s:.3g} times the noise of the fit)"
            for t, e, r, s in zip(self.rows.targets, self.rms, self.relative, self.noise, strict=True)
        )
        return f"held-out error, rms: {errors}"


def identify(
    rows: Rows,
    free: Sequence[str] | None = None,
    *,
    nonnegative: bool | Sequence[str] = True,
    confidence: Confidence = "auto",
    noise: Array | None = None,
    test: Sequence[Sequence[str]] | None = None,
) -> Identification:
    """Fit parameters to the rows by weighted least squares; the weight of each target is its noise, from the residuals.

    Args:
        rows: from `rows_of`.
        free: parameters of the rows to estimate; an array's name stands for all its entries. The others keep their
            nominal values. None estimates all.
        nonnegative: which free parameters must not be negative, as masses and friction: all, none, or these names. An
            active-set method finds the bounded optimum; the result lists parameters held at zero.
        confidence: what the covariance assumes about the residuals: "white", "newey_west" (coloured, sandwich), or
            "auto", which takes "newey_west" if the residuals of a target are not white. The variances of "auto" are at
            least those of the sandwich without lags, which allows for noise that grows with the speed.
        noise: known standard deviation of the filtered efforts (m,); None takes that of the residuals.
        test: groups of fixed parameters to test for in the residuals; by default one group per array.

    Raises ModelError for an unknown name, if an effort is always zero, if every parameter would be negative, and if the
    motion does not determine the parameters (naming those that cannot be separated).

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> rows = gt.identify.rows_of(gt.measurements.session_of(log), regressor)
    >>> fit = gt.identify.identify(rows)
    >>> fit.estimate.values.round(1), fit.estimate.std.round(2)  # true are 2 kg, 5 kg/s, 3 N
    (array([2., 5., 3.]), array([0.01, 0.06, 0.02]))
    """
    chosen = among(rows.names, rows.names if free is None else free)
    names = [rows.names[k] for k in chosen]
    zero = [t for t, column in zip(rows.targets, rows.effort.T, strict=True) if not np.any(column)]
    if zero:
        raise ModelError(f"{', '.join(zero)} is always zero; check which column holds the measured effort")
    equations = _LeastSquares(rows, chosen, noise is not None)
    size = np.ones(len(rows.targets)) if noise is None else np.asarray(noise, dtype=float)
    unbounded = equations.fit(size)
    for _ in range(0 if noise is not None else WEIGHTINGS):
        size = _spread(equations.residuals(unbounded), len(chosen))
        unbounded = equations.fit(size)
    bounded = _bounded(rows, names, nonnegative)
    negative = any(unbounded.value(n) < 0 for n in bounded)
    estimate = equations.fit(size, bounded) if negative else unbounded
    if not estimate.names:
        raise ModelError(
            f"every parameter would be negative ({', '.join(f'{n} = {unbounded.value(n):.3g}' for n in names[:3])}"
            f"{', ...' if len(names) > 3 else ''}); check the signs of the efforts and of the position"
        )
    residuals = equations.residuals(estimate)
    verdicts = tuple(whiteness(r) for r in residuals.T)
    coloured = confidence == "newey_west" or (confidence == "auto" and not all(v.passed for v in verdicts))
    uneven = confidence == "auto" and noise is None
    if coloured or uneven:
        unbounded = equations.sandwich(unbounded, size, coloured, uneven)
        estimate = equations.sandwich(estimate, size, coloured, uneven) if negative else unbounded
    groups = _groups(rows, equations.rest) if test is None else [g for g in (among(rows.names, g) for g in test) if g]
    weighted = rows.columns(chosen, size)
    return Identification(
        rows,
        {rows.names[k]: float(rows.nominal[k]) for k in equations.rest},
        estimate,
        unbounded,
        size,
        residuals,
        verdicts,
        "newey_west" if coloured else "white",
        # the triangular factor has the singular values and the null space of the rows
        identifiability(
            np.linalg.qr(weighted.reshape(-1, len(chosen)), mode="r"), names, scale=equations.scale, poses=len(rows)
        ),
        tuple(_left_out(rows, group, weighted, residuals / size, size, coloured, len(groups)) for group in groups),
    )


class _LeastSquares:
    """Rows as equations for some parameters, with the others at their nominal values."""

    def __init__(self, rows: Rows, columns: Sequence[int], known: bool) -> None:
        self.rest = [k for k in range(len(rows.names)) if k not in columns]
        self.A = rows.Y[:, :, columns]
        self.b = rows.effort - rows.y0 - rows.Y[:, :, self.rest] @ rows.nominal[self.rest]
        self.names, self.units = [rows.names[k] for k in columns], [rows.units[k] for k in columns]
        self.scale, self.starts, self.known = nominal_sizes(rows.nominal[columns], self.units), rows.starts, known

    def fit(self, size: Array, nonnegative: Sequence[str] = ()) -> Estimate:
        """Fit with the targets divided by `size` (m,), which is the noise if it is known."""
        sizes = np.tile(size, len(self.b))
        try:
            return linear_fit(
                self.A.reshape(-1, len(self.names)),
                self.b.reshape(-1),
                self.names,
                bounds={n: (0.0, np.inf) for n in nonnegative},
                sigma=sizes if self.known else None,
                weights=None if self.known else 1 / sizes**2,
                scale=self.scale,
                units=self.units,
            )
        except ValueError as error:
            raise ModelError(f"the motion does not determine the parameters: {error}") from error

    def residuals(self, estimate: Estimate) -> Array:
        """Measured minus modelled efforts (n, m)."""
        return self.b - self.A @ np.array([estimate.value(n) for n in self.names])

    def sandwich(self, estimate: Estimate, size: Array, coloured: bool, uneven: bool) -> Estimate:
        """The estimate with the covariance for coloured residuals, for residuals of uneven variance, or both."""
        free = [self.names.index(n) for n in estimate.names]
        J, r = self.A[:, :, free] / size[:, None], self.residuals(estimate) / size
        covariance = newey_west(J, r, starts=self.starts) if coloured else estimate.covariance
        if uneven:
            covariance = larger(covariance, newey_west(J, r, starts=self.starts, lags=0))
        return replace(estimate, covariance=covariance)


def _bounded(rows: Rows, names: Sequence[str], nonnegative: bool | Sequence[str]) -> list[str]:
    """Those of these parameters that must not be negative."""
    if isinstance(nonnegative, bool):
        return [n for n in names if nonnegative and n not in rows.signed]
    return [n for n in (rows.names[k] for k in among(rows.names, nonnegative)) if n in names]


def bias_of(rows: Rows, free: Sequence[str], truth: dict[str, float], noise: Array | None = None) -> dict[str, float]:
    """Return the bias of each free parameter that fixed parameters with wrong nominal values cause.

    `free` names the fitted parameters; `truth` has true values [SI] of fixed ones; `noise` (m,) weighs the targets.
    The result, estimate minus truth by name, is the omitted-variable bias of weighted least squares,
    (A'A)^-1 A'B (truth - nominal), with A the columns of the free and B those of the fixed parameters.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> time = 0.004 * np.arange(2000)
    >>> q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    >>> log = gt.identify.LogSimulator(Axis(), q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d", "c"])
    >>> rows = gt.identify.rows_of(gt.measurements.session_of(log), regressor)
    >>> bias = gt.identify.bias_of(rows, ["m", "d"], {"c": 4.0})  # held at 3 N
    >>> {name: round(value, 1) for name, value in bias.items()}  # viscous friction takes up what is missing
    {'m': 0.0, 'd': 1.9}
    """
    fitted, fixed = among(rows.names, free), among(rows.names, list(truth))
    size = np.ones(rows.effort.shape[1]) if noise is None else noise
    A, B = (rows.columns(k, size).reshape(-1, len(k)) for k in (fitted, fixed))
    missing = np.array([truth[rows.names[k]] for k in fixed]) - rows.nominal[fixed]
    shift = np.linalg.lstsq(A, B @ missing, rcond=None)[0]
    return {rows.names[k]: float(s) for k, s in zip(fitted, shift, strict=True)}


def _spread(residuals: Array, parameters: int) -> Array:
    """Standard deviation of each target (m,); the targets share the parameters' degrees of freedom."""
    n, m = residuals.shape
    return np.sqrt(np.sum(residuals**2, axis=0) / max(1.0, n - parameters / m))


def _groups(rows: Rows, rest: Sequence[int]) -> list[list[int]]:
    """Fixed parameters grouped by array."""
    groups: dict[str, list[int]] = {}
    for k in rest:
        groups.setdefault(rows.names[k].partition("[")[0], []).append(k)
    return list(groups.values())


def _left_out(
    rows: Rows, group: Sequence[int], weighted: Array, residuals: Array, size: Array, coloured: bool, tests: int
) -> LeftOut:
    """F test of a group of columns after the fitted ones: the drop of the residual sum of squares if they were free.

    For coloured residuals it is the Wald test with their covariance.
    """
    A = weighted.reshape(-1, weighted.shape[2])
    B = rows.columns(group, size).reshape(len(A), -1)
    Q = np.linalg.qr(A)[0]
    beyond = B - Q @ (Q.T @ B)
    r = residuals.reshape(-1)
    W, R = np.linalg.qr(beyond)
    k, degrees_of_freedom = len(group), len(r) - A.shape[1] - len(group)
    names = tuple(rows.names[i] for i in group)
    along = W.T @ r
    if coloured and np.linalg.matrix_rank(R) == k:
        remainder = (r - W @ along).reshape(residuals.shape)
        covariance = newey_west(W.reshape(*residuals.shape, k), remainder, starts=rows.starts)
        F = float(along @ np.linalg.solve(covariance, along)) / k
    else:
        F, _ = f_test(float(r @ r), float(r @ r - along @ along), k, degrees_of_freedom)
    return LeftOut(names, F, float(f_chance(F, k, degrees_of_freedom)), tests)
