"""What a solved block is: assignments in order, with the margins that decide its status."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..results.status import Status

# the status of a margin on the wrong side, by kind
VERDICTS = {
    "discriminant": Status.OUT_OF_RANGE,
    "condition": Status.OUT_OF_RANGE,
    "pivot": Status.SINGULAR,
    "branch": Status.WRONG_BRANCH,
}


@dataclass(frozen=True, eq=False)
class Margin:
    """A number that must stay on the good side: discriminant or condition >= 0, |pivot| and branch above a tolerance.

    `kind` is one of VERDICTS: a condition is on known values, a branch shows where Newton has led, as far as round-off
    lets it; `scale` (typical size) is found at the sample points.
    """

    kind: str
    expression: ca.SX
    label: str
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Root:
    """A square root with a branch: `sign` is a symbol, `slope` = 2 qa t + qb has this sign at a known point.

    `settled_by` names the declared branch that distinguishes its two solutions; empty: the start values do.
    """

    sign: ca.SX
    slope: ca.SX
    label: str
    value: int = 0
    settled_by: str = ""


@dataclass(eq=False)
class NewtonBlock:
    """Equations without a closed form: residuals of the unknowns that are left after elimination.

    `z0` and `scale` (nominals) are set from the sample points; labels name the unknowns.
    """

    unknowns: list[ca.SX]
    residuals: list[ca.SX]
    labels: list[str]
    scale: np.ndarray

    @property
    def size(self) -> int:
        return len(self.unknowns)


@dataclass(frozen=True, eq=False)
class DenseCore:
    """matrix @ unknowns == right: what of a linear block no pivot of constants solves, from four unknowns on."""

    unknowns: list[ca.SX]
    matrix: ca.SX
    right: ca.SX


@dataclass(frozen=True, eq=False)
class SolvedBlock:
    """One block: unknown symbols in order with their expressions of earlier symbols.

    `uses`: per equation the names of all symbols in it, for the picture of the block-triangular form. `closures`: the
    residuals of a block that is not linear in its unknowns. `core`: of a linear one, which `assignments` solve too;
    the margins of such a block are its pivots.
    """

    kind: str
    unknowns: list[str]
    equations: list[str]
    assignments: list[tuple[ca.SX, ca.SX]]
    margins: list[Margin] = field(default_factory=list)
    roots: list[Root] = field(default_factory=list)
    detail: str = ""
    newton: NewtonBlock | None = None
    uses: tuple[tuple[str, ...], ...] = ()
    closures: tuple[ca.SX, ...] = ()
    core: DenseCore | None = None
