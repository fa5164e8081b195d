"""Masses and friction from motion by weighted least squares, with covariance, tests and a feasible variant."""

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
from gtmodel.lang import ModelError
from gtmodel.results.estimate import Estimate

from .delay import Delay, delay_of
from .regressor import among
from .rows import Rows

Array = np.ndarray
Confidence = Literal["auto", "white", "newey_west"]

WEIGHTINGS = 2  # rounds of noise per target and fit; a third one changes no digit that is shown


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Whether the residuals hold what a parameter that was left out would explain: F statistic and p-value.

    `names` are the parameters of the group; `tests` says how many groups are tried together, each with its part of the
    false alarms.
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
            return f"residuals show nothing of {names} (F = {self.F:.3g}, p = {self.p:.2g})"
        return (
            f"residuals hold what {names} would explain (F = {self.F:.3g}, p = {self.p:.2g}): the other parameters "
            "have taken the rest of it, so free these too"
        )


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified model.

    `rows` are those that were fitted, n of them with m targets; `fixed` the parameters that kept their nominal values.
    `estimate` has values, covariance and intervals [SI]; what ended at its bound is `estimate.held`. `unbounded` is the
    fit without bounds (the same object where no bound acted). `residuals` (n, m) are measured minus modelled efforts,
    `noise` (m,) is their standard deviation by target. `whiteness` has one verdict per target. `confidence` says what
    the covariance assumes, "white" or "newey_west". `identifiability` is that of the scaled, weighted regressor,
    `left_out` has the tests of what was fixed.
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
        """Values (p,) of all parameters of the rows, fixed ones too, in their order."""
        return np.array(
            [self.fixed[n] if n in self.fixed else self.estimate.value(n) for n in self.rows.names], dtype=float
        )

    @property
    def numbers(self) -> dict[str, float]:
        """What was estimated of the model, at its bound or not, by name in the order of the rows."""
        known = {*self.estimate.names, *self.estimate.held} - {*self.rows.signed}
        return {n: self.estimate.value(n) for n in self.rows.names if n in known}

    def modelled(self, rows: Rows | None = None) -> Array:
        """Modelled efforts (n, m) of these rows, or of others (Dressler 2012, Figs. 6.5 and 6.6)."""
        rows = self.rows if rows is None else rows
        return rows.Y @ self.parameters + rows.y0

    def validate(self, rows: Rows) -> Validation:
        """Errors on the rows of a motion that the fit has not seen. Raises ModelError for another regressor's rows."""
        if rows.names != self.rows.names:
            raise ModelError("the other motion was prepared with another regressor; use the same one")
        return Validation(rows, rows.effort - self.modelled(rows), self.noise, self._judged(rows))

    def _judged(self, rows: Rows) -> tuple[HeldOut, ...]:
        """Held-out rms error over the noise of the fit, by target, against what a sound model has."""
        e = self.estimate
        at = [rows.names.index(n) for n in e.names]
        errors, m = rows.effort - self.modelled(rows), len(rows.targets)
        judged = []
        for t, (noise, residuals) in enumerate(zip(self.noise, self.residuals.T, strict=True)):
            Y = rows.Y[:, t, at] / noise
            # what the errors of the parameters add to the noise of each row, in its units
            CM = e.covariance @ (Y.T @ Y)
            n, extra, squared = len(Y), float(np.trace(CM)), float(np.trace(CM @ CM))
            together = correlation_time(residuals)
            judged.append(
                held_out_ratio(
                    float(np.sqrt(np.mean(errors[:, t] ** 2)) / noise),
                    1 + extra / n,
                    max(len(residuals) - len(e.names) / m, 0.0) / together,
                    freedom_of(n + extra, n * together + 2 * extra + squared),
                    tests=m,
                )
            )
        return tuple(judged)

    @cached_property
    def delay(self) -> Delay | None:
        """Whether the efforts come later than the positions, see `delay_of`."""
        return delay_of(self)

    @property
    def notes(self) -> list[str]:
        """What limits the numbers, in words."""
        lines = [
            f"{n} is at its bound, 0, and would be {self.unbounded.value(n):.3g} without it; it has no interval, and "
            "the others are as if it were known; if it may be negative, leave it out of nonnegative"
            for n in self.estimate.held
        ]
        lines += list(self.estimate.notes)
        lines += [f"{t}: {v.message}" for t, v in zip(self.rows.targets, self.whiteness, strict=True) if not v.passed]
        lines += [t.message for t in self.left_out if not t.passed]
        if self.delay is not None and not self.delay.passed:
            lines.append(self.delay.message)
        limits = [(n, *self.estimate.interval(n)) for n in self.estimate.names]
        sentence = "{} cannot be distinguished from zero: {:.3g} to {:.3g}"
        return lines + [sentence.format(n, low, high) for n, low, high in limits if low <= 0 <= high]


@dataclass(frozen=True, eq=False)
class Validation:
    """Errors (n, m) on the `rows` of another motion, measured minus modelled, beside the fit's `noise` (m,).

    `judged` (m,): their size over the fit's noise, against what a sound model has.
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
        each = ", ".join(
            f"{t} {e:.3g} ({100 * r:.2g} %, {e / s:.3g} times the fit's own)"
            for t, e, r, s in zip(self.rows.targets, self.rms, self.relative, self.noise, strict=True)
        )
        return f"held-out error, rms: {each}"


def identify(
    rows: Rows,
    free: Sequence[str] | None = None,
    *,
    nonnegative: bool | Sequence[str] = True,
    confidence: Confidence = "auto",
    noise: Array | None = None,
    test: Sequence[Sequence[str]] | None = None,
) -> Identification:
    """Weighted least squares on the rows: each target weighs by its own noise, which the residuals determine.

    Args:
        rows: from `rows_of`.
        free: parameters of the rows to be estimated, an array's name for all its entries; the others keep their
            nominal values. All if left out.
        nonnegative: masses and friction are nonnegative: all free parameters, none, or these. What would be negative is
            held at zero, and the result says so; it is the least-squares optimum under bounds, by its active set.
        confidence: what the covariance assumes of the residuals: "white", "newey_west" (coloured, sandwich), or "auto",
            which takes the second where a target's residuals are not white.
        noise: known standard deviation of the filtered efforts (m,), or None for that of the residuals.
        test: groups of fixed parameters whose traces the residuals are searched for; each array of those by default.

    Raises ModelError for an unknown name, for efforts that are zero all the time, where every parameter would be
    negative, and where the motion does not determine the parameters (saying which move together).

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
    (array([2. , 4.9, 3. ]), array([0.01, 0.06, 0.03]))
    """
    at = among(rows.names, rows.names if free is None else free)
    names = [rows.names[k] for k in at]
    idle = [t for t, column in zip(rows.targets, rows.effort.T, strict=True) if not np.any(column)]
    if idle:
        raise ModelError(f"{', '.join(idle)} is zero all the time; check which column holds the measured effort")
    least = _LeastSquares(rows, at, noise is not None)
    size = np.ones(len(rows.targets)) if noise is None else np.asarray(noise, dtype=float)
    unbounded = least.fit(size)
    for _ in range(0 if noise is not None else WEIGHTINGS):
        size = _spread(least.left(unbounded), len(at))
        unbounded = least.fit(size)
    bounded = _bounded(rows, names, nonnegative)
    negative = any(unbounded.value(n) < 0 for n in bounded)
    estimate = least.fit(size, bounded) if negative else unbounded
    if not estimate.names:
        raise ModelError(
            f"every parameter would be negative ({', '.join(f'{n} = {unbounded.value(n):.3g}' for n in names[:3])}"
            f"{', ...' if len(names) > 3 else ''}); check the signs of the efforts and of the position"
        )
    residuals = least.left(estimate)
    verdicts = tuple(whiteness(r) for r in residuals.T)
    coloured = confidence == "newey_west" or (confidence == "auto" and not all(v.passed for v in verdicts))
    if coloured:
        unbounded = least.sandwich(unbounded, size)
        estimate = least.sandwich(estimate, size) if negative else unbounded
    groups = _groups(rows, least.rest) if test is None else [g for g in (among(rows.names, g) for g in test) if g]
    weighted = rows.columns(at, size)
    return Identification(
        rows,
        {rows.names[k]: float(rows.nominal[k]) for k in least.rest},
        estimate,
        unbounded,
        size,
        residuals,
        verdicts,
        "newey_west" if coloured else "white",
        # the triangle of the QR has the singular values and the null space of the rows
        identifiability(
            np.linalg.qr(weighted.reshape(-1, len(at)), mode="r"), names, scale=least.scale, poses=len(rows)
        ),
        tuple(_left_out(rows, group, weighted, residuals / size, size, coloured, len(groups)) for group in groups),
    )


class _LeastSquares:
    """Rows as equations of the parameters at some places, the others at their nominal values."""

    def __init__(self, rows: Rows, at: Sequence[int], known: bool) -> None:
        self.rest = [k for k in range(len(rows.names)) if k not in at]
        self.A = rows.Y[:, :, at]
        self.b = rows.effort - rows.y0 - rows.Y[:, :, self.rest] @ rows.nominal[self.rest]
        self.names, self.units = [rows.names[k] for k in at], [rows.units[k] for k in at]
        self.scale, self.starts, self.known = nominal_sizes(rows.nominal[at], self.units), rows.starts, known

    def fit(self, size: Array, nonnegative: Sequence[str] = ()) -> Estimate:
        """Targets weigh by their sizes (m,), which are the noise itself where it is known."""
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

    def left(self, estimate: Estimate) -> Array:
        """Residuals (n, m)."""
        return self.b - self.A @ np.array([estimate.value(n) for n in self.names])

    def sandwich(self, estimate: Estimate, size: Array) -> Estimate:
        """With the covariance of coloured residuals."""
        kept = [self.names.index(n) for n in estimate.names]
        covariance = newey_west(self.A[:, :, kept] / size[:, None], self.left(estimate) / size, starts=self.starts)
        return replace(estimate, covariance=covariance)


def _bounded(rows: Rows, names: Sequence[str], nonnegative: bool | Sequence[str]) -> list[str]:
    """Which of these parameters must not be negative."""
    if isinstance(nonnegative, bool):
        return [n for n in names if nonnegative and n not in rows.signed]
    return [n for n in (rows.names[k] for k in among(rows.names, nonnegative)) if n in names]


def bias_of(rows: Rows, free: Sequence[str], truth: dict[str, float], noise: Array | None = None) -> dict[str, float]:
    """By how much each free parameter is off when others are held at nominal values that differ from their `truth`.

    `free` are the parameters that are fitted, by name; `truth` has the true values of the ones that are held [SI];
    `noise` (m,) weighs the targets. The result, estimate minus truth by name, is the omitted-variable bias of weighted
    least squares, (A'A)^-1 A'B (truth - nominal), with A the columns of the free and B those of the held parameters.

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
    {'m': 0.0, 'd': 1.8}
    """
    at, out = among(rows.names, free), among(rows.names, list(truth))
    size = np.ones(rows.effort.shape[1]) if noise is None else noise
    A, B = (rows.columns(k, size).reshape(-1, len(k)) for k in (at, out))
    missing = np.array([truth[rows.names[k]] for k in out]) - rows.nominal[out]
    shift = np.linalg.lstsq(A, B @ missing, rcond=None)[0]
    return {rows.names[k]: float(s) for k, s in zip(at, shift, strict=True)}


def _spread(residuals: Array, parameters: int) -> Array:
    """Standard deviation of each target (m,); the parameters' degrees of freedom are shared among the targets."""
    n, m = residuals.shape
    return np.sqrt(np.sum(residuals**2, axis=0) / max(1.0, n - parameters / m))


def _groups(rows: Rows, rest: Sequence[int]) -> list[list[int]]:
    """Fixed parameters gathered by the array that they are entries of."""
    groups: dict[str, list[int]] = {}
    for k in rest:
        groups.setdefault(rows.names[k].partition("[")[0], []).append(k)
    return list(groups.values())


def _left_out(
    rows: Rows, group: Sequence[int], weighted: Array, residuals: Array, size: Array, coloured: bool, tests: int
) -> LeftOut:
    """F test of the columns of a group after the fitted ones: the drop of the squares if they were free too; of
    coloured residuals Wald's with the covariance that they have."""
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
        left = (r - W @ along).reshape(residuals.shape)
        covariance = newey_west(W.reshape(*residuals.shape, k), left, starts=rows.starts)
        F = float(along @ np.linalg.solve(covariance, along)) / k
    else:
        F, _ = f_test(float(r @ r), float(r @ r - along @ along), k, degrees_of_freedom)
    return LeftOut(names, F, float(f_chance(F, k, degrees_of_freedom)), tests)
