"""Base parameters of a serial arm: combinations of masses, first moments and inertias that determine its efforts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..compiler.causal import flat_of
from ..inference import Dependencies, dependencies
from ..lang import Model, ModelError
from ..results import Status
from ..robots import SerialArm
from .regressor import Regressor, RegressorRows

Array = np.ndarray
BODIES = ("m", "mc", "J")
POINTS, SEED = 60, 1  # random motions that determine the rank: a few hundred equations for 60 unknowns
RANGE = np.pi  # rad or m, of a joint without limits
NOTHING = 1e-9  # relative to the largest term of a combination: rounding error
SHOWN = 3  # terms of a combination in its name


class BaseRegressor(Regressor):
    """A regressor in the base parameters of a serial arm and further parameters, such as friction.

    The efforts depend on fewer combinations than the ten numbers m, mc and J of each link. A QR factorisation of the
    regressor at random motions within the joint limits finds them for any arm and any direction of gravity. Each
    combination is named after the parameter that is kept; links near the base and inertias are kept first.

    Args:
        arm: the arm, with known geometry.
        more: further parameters, as for `Regressor`.
        known, targets: as for `Regressor`.

    Attributes in addition to those of `Regressor`, whose names, nominal and units describe the base parameters:
    dependencies: the linear dependencies among the parameters; `everything`: names of all parameters; `matrix`
    (base, all): base parameters = matrix @ values.

    Raises ModelError if `arm` is not a serial arm.

    Two parallel axes perpendicular to gravity, each link frame at the link's end: six combinations of 20 numbers
    matter.

    >>> arm = gt.robots.serial_arm(a=[0.5, 0.4], alpha=0.0, base_rpy=[np.pi / 2, 0.0, 0.0], m=[2.0, 1.0])
    >>> base = gt.identify.BaseRegressor(arm)
    >>> for name, value in zip(base.names, base.nominal):
    ...     print(f"{value:6.3f}  {name}")
    ...
    -0.750  J[0,5] - 0.25 m[0] - 0.25 m[1]
     1.500  mc[0,0] + 0.5 m[0] + 0.5 m[1]
     0.000  mc[0,1]
    -0.160  J[1,5] - 0.16 m[1]
     0.400  mc[1,0] + 0.4 m[1]
     0.000  mc[1,1]
    """

    def __init__(
        self,
        arm: Model,
        more: Sequence[str] = (),
        known: str | Sequence[str] = "q",
        targets: str | Sequence[str] = "tau",
    ) -> None:
        if not isinstance(arm, SerialArm):
            raise ModelError(
                f"base parameters need a serial arm, from a URDF or Denavit-Hartenberg numbers; found {arm!r}"
            )
        super().__init__(arm, [*more, *_body_names(arm)], known, targets, idle=True)
        self.everything = self.names
        values, units = self.nominal, dict(zip(self.names, self.units, strict=True))
        stacked = _stacked(self, arm)
        first = len(self.everything) - 10 * len(arm.structure.joints)
        bodies = list(self.everything[first:])
        self.dependencies: Dependencies = dependencies(
            stacked, self.everything, keep=[*bodies, *self.everything[:first]]
        )
        independent = [n for n in self.everything if n in self.dependencies.independent]
        self._independent = [self.everything.index(n) for n in independent]
        self.matrix = np.zeros((len(independent), len(self.everything)))
        for row, name in enumerate(independent):
            for term, factor in self.dependencies.base(name).items():
                self.matrix[row, self.everything.index(term)] = factor
        self.names = tuple(_combination(self.dependencies.base(n)) for n in independent)
        self.base = tuple(n for n in self.names if n.startswith(tuple(f"{name}[" for name in BODIES)))
        self.units = tuple(units[n] for n in independent)
        self.nominal = _without_rounding(self.matrix, values)

    def __call__(self, *rows: Any) -> RegressorRows:
        values = super().__call__(*rows)
        return RegressorRows(values.Y[:, :, self._independent], values.y0, values.status)

    @property
    def combinations(self) -> dict[str, dict[str, float]]:
        """Terms of each base parameter by its name: parameter -> factor."""
        return {
            name: {self.everything[k]: float(row[k]) for k in np.flatnonzero(row)}
            for name, row in zip(self.names, self.matrix, strict=True)
        }

    @property
    def notes(self) -> list[str]:
        """Which parameters any motion of the arm determines, alone or in combinations, and which none does."""
        count = np.count_nonzero(self.matrix, axis=1)
        used = np.any(self.matrix, axis=0)
        together = np.any(self.matrix[count > 1], axis=0)
        alone, sums, without = (
            _ranges([n for n, chosen in zip(self.everything, where, strict=True) if chosen])
            for where in (used & ~together, together, ~used)
        )
        sentences = [
            f"the efforts depend on {len(self.everything)} parameters through {len(self.names)} combinations, the base "
            "parameters; no motion determines more",
            f"determined alone: {alone}" if alone else "",
            f"only in combinations (base_parameters lists the terms of each): {sums}" if sums else "",
            f"without any effect on the efforts: {without}" if without else "",
        ]
        return [s for s in sentences if s]

    def numbers_of(self, values: Mapping[str, float]) -> dict[str, float]:
        everything = _without_rounding(self.matrix, np.array([values[n] for n in self.everything]))
        return dict(zip(self.names, everything.tolist(), strict=True))


def _body_names(arm: SerialArm) -> list[str]:
    """Inertias, first moments and mass of each link, from the base outwards; earlier names are kept first."""
    names: list[str] = []
    for k in range(len(arm.structure.joints)):
        names += [*(f"J[{k},{i}]" for i in range(6)), *(f"mc[{k},{i}]" for i in range(3)), f"m[{k}]"]
    return names


def _stacked(regressor: Regressor, arm: SerialArm) -> Array:
    """The regressor stacked over random motions (rows, p)."""
    limits = arm.structure.limits()
    low, high = np.clip(limits, -RANGE, RANGE).T
    rng = np.random.default_rng(SEED)
    n = len(arm.structure.leaders)
    draw = {"q": rng.uniform(low, high, (POINTS, n))}
    draw |= {f"der(q{order})": rng.standard_normal((POINTS, n)) for order in ("", ",2")}
    draw |= {s.name: rng.standard_normal((POINTS, *s.shape)) for s in regressor.inputs if s.name not in draw}
    values = Regressor.__call__(regressor, *[draw[s.name] for s in regressor.inputs])
    Y, _ = RegressorRows(*[x[values.status == Status.OK] for x in values]).stacked()
    return Y


def _without_rounding(matrix: Array, values: Array) -> Array:
    terms = matrix * values
    total = terms.sum(axis=1)
    return np.where(np.abs(total) > NOTHING * np.abs(terms).max(axis=1, initial=0.0), total, 0.0)


def _combination(terms: dict[str, float]) -> str:
    """The combination as text: the kept parameter, then the largest terms; all of them if they are few."""
    (first, _), *others = terms.items()
    text = first
    for k, (name, factor) in enumerate(others):
        if k == SHOWN - 1 and len(others) > SHOWN - 1:
            return f"{text} + ..."
        written = f"{abs(factor):.4g}"
        size = "" if written == "1" else f"{written} "
        text += f" {'-' if factor < 0 else '+'} {size}{name}"
    return text


def _ranges(names: Sequence[str]) -> str:
    """Names in one line: "m[1]", "m[2]", "m[3]" become m[1..3]."""
    runs: list[tuple[str, int, int]] = []  # beginning of the name, first and last index
    for name in names:
        start, index = re.fullmatch(r"(.*?)(\d*)\]?", name).groups()  # pyrefly: ignore[missing-attribute]
        number = int(index or -1)
        if runs and runs[-1][0] == start and number == runs[-1][2] + 1:
            runs[-1] = (start, runs[-1][1], number)
        else:
            runs.append((start, number, number))
    return ", ".join(
        start + ("" if last < 0 else f"{first}]" if first == last else f"{first}..{last}]")
        for start, first, last in runs
    )


def parameters_of(arm: Model) -> dict[str, float]:
    """All scalar parameters of a model by name."""
    return {q.name: q.value for q in flat_of(arm).parameters}
