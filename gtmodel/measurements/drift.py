"""Slow changes of readings: unknowns that describe them, and tests that name one that is left out.

Used for the bias of a force sensor, the place of a measuring device, and the bias of a gyro.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from ..results.refusal import ArgumentError

if TYPE_CHECKING:
    from ..results.suspicion import Suspicion

DriftKind = Literal["none", "linear", "session", "temperature", "blocks", "random_walk"]
MOST_BLOCKS, ROWS = 10, 6  # blocks, and rows in each: our choice, by the coverage under random walks in the tests
LEAST_BLOCKS = 4  # more than the three components of a first moment
ALONE = ("none", "blocks")
IRREGULAR = ("blocks", "random_walk")
HOUR = 3600.0  # s


@dataclass(frozen=True, eq=False)
class DriftBasis:
    """Conditions of the rows (n,), and the drifts to estimate, relative to the last row.

    time [s]; session: numbers of the recordings, or None; temperature [K], or None. clock: whether the time was
    measured; otherwise it counts the rows. origin: time and temperature at which the drift is zero; by default those of
    the last row.
    """

    kinds: tuple[DriftKind, ...]
    time: np.ndarray
    session: np.ndarray | None = None
    temperature: np.ndarray | None = None
    clock: bool = True
    origin: tuple[float, float] | None = None

    @property
    def starts(self) -> tuple[int, ...]:
        """First row of each session."""
        changes = [] if self.session is None else np.flatnonzero(np.diff(self.session)) + 1
        return (0, *(int(k) for k in changes))

    @property
    def blocks(self) -> np.ndarray:
        """Block of each row, from 0."""
        count = len(self.time)
        return np.arange(count) * min(MOST_BLOCKS, count // ROWS) // count

    @property
    def running(self) -> np.ndarray:
        """Increasing times (n,) [s]: a clock that restarts goes on one median step after the row before."""
        step = np.diff(self.time)
        return np.concatenate([[0.0], np.cumsum(np.where(step > 0, step, np.median(step[step > 0])))])

    def columns(self) -> list[tuple[str, str, np.ndarray]]:
        """Prefix of the names, unit after that of the readings, and column (n,) of each drift to estimate."""
        parts = list[tuple[str, str, np.ndarray]]()
        if "linear" in self.kinds:
            parts.append(("drift", "/s", self.time - (self.time[-1] if self.origin is None else self.origin[0])))
        if "temperature" in self.kinds and self.temperature is not None:
            zero = self.temperature[-1] if self.origin is None else self.origin[1]
            parts.append(("thermal", "/K", self.temperature - zero))
        if "session" in self.kinds and self.session is not None:
            parts += groups("session", self.session)
        if "blocks" in self.kinds:
            parts += groups("block", self.blocks + 1)
        return parts

    def suspicions(
        self, name: str, unit: str, J: np.ndarray, rest: np.ndarray, *, least: float = 0.0, key: str = "drift",
        other: str = "", kinds: Collection[DriftKind] = get_args(DriftKind), by: np.ndarray | None = None,
        white: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> list[Suspicion]:  # fmt: skip
        """Test whether residuals (n, channels) in `unit`, of a fit with Jacobian J (n, channels, p), drift with each
        condition. A drift that is estimated leaves nothing to test; intervals of irregular drifts allow for all.

        name: of the readings, such as "force". key: of the file, and kinds: its values, for the remedies; other:
        another remedy. by: derivative (n, channels, k) of the residuals by the readings in `unit`; by default each
        residual is that of one reading. white: whitens columns (n, channels, k), if J and the residuals are whitened.
        """
        from ..results.suspicion import Suspicion
        from .inspection import residual_tests

        if set(IRREGULAR) & set(self.kinds):
            return []

        def remedy(kind: DriftKind) -> str:
            return "; or ".join(part for part in (f'set {key} = "{kind}"' if kind in kinds else "", other) if part)

        over, span = "the recording", float(np.ptp(self.running))
        outcomes = [residual_tests.drifts(
            J, rest, self.time, remedy("linear"), name=f"{name}_drift", unit=unit, least=least, over=over,
            rate=HOUR / span if self.clock and span > 0 else 0.0, by=by, white=white,
        )]  # fmt: skip
        if self.temperature is not None and np.ptp(self.temperature) > 0:
            over = f"the range of temperature, {np.ptp(self.temperature):.3g} K,"
            outcomes.append(residual_tests.drifts(
                J, rest, self.temperature, remedy("temperature"), name=f"{name}_temperature", unit=unit, least=least,
                over=over, by=by, white=white,
            ))  # fmt: skip
        if self.session is not None and len(self.starts) > 1:
            rows = rest.reshape(len(rest), -1)
            each = np.array([column for _, _, column in groups("session", self.session)])
            columns = np.einsum("kn,ij->nikj", each, np.eye(rows.shape[1]))
            test = residual_tests.explained_by(J, rows, columns.reshape(*rows.shape, -1), least=least)
            means = np.array([rows[self.session == s].mean(axis=0) for s in np.unique(self.session)])
            size = float(np.linalg.norm(means[:, None] - means, axis=2).max())
            text = f"the biases of the sessions differ by up to {size:.3g} {unit} ({residual_tests.shown_p(test.p)})"
            outcomes.append(Suspicion(f"{name}_session", text, test.p, remedy("session")))
        return outcomes


def drift_basis(
    drift: bool | DriftKind | Sequence[DriftKind], rows: int, time: ArrayLike | None = None,
    session: ArrayLike | None = None, temperature: ArrayLike | None = None,
    kinds: Collection[DriftKind] = get_args(DriftKind),
) -> DriftBasis:  # fmt: skip
    """Return the drift to estimate, with conditions by row.

    True is "linear", False "none". time (rows,) [s], increasing in each session. kinds: that may be estimated. Raises
    ArgumentError about "drift", "time", "session" or "temperature".

    >>> from gtmodel.measurements.drift import drift_basis
    >>> [(name, column.tolist()) for name, _, column in drift_basis("linear", 3, [0.0, 1.0, 4.0]).columns()]
    [('drift', [-4.0, -3.0, 0.0])]
    """
    chosen = _kinds(drift, kinds)
    for kind, given in (("linear", time), ("session", session), ("temperature", temperature)):
        if kind in chosen and given is None:
            argument = "time" if kind == "linear" else kind
            raise ArgumentError(f"is needed to estimate a drift ({kind})", argument)
    numbers = None if session is None else _row(session, rows, "session")
    kelvins = None if temperature is None else _row(temperature, rows, "temperature")
    if kelvins is not None and "temperature" in chosen and not np.ptp(kelvins) > 0:
        raise ArgumentError("is the same in all poses; a drift with temperature needs it to change", "temperature")
    t = np.arange(float(rows)) if time is None else _row(time, rows, "time")
    known = DriftBasis(chosen, t, numbers, kelvins, time is not None)
    if numbers is not None and len(known.starts) > len(np.unique(numbers)):
        raise ArgumentError("begins again after another session; sort the rows by session", "session")
    backward = np.diff(t) <= 0
    backward[np.array(known.starts[1:], int) - 1] = False  # the clock may restart
    if backward.any():
        raise ArgumentError(f"expected {rows} increasing numbers, one per pose; found {t[1:][backward][0]:g} after "
                            f"{t[:-1][backward][0]:g}", "time")  # fmt: skip
    if "blocks" in chosen and rows < LEAST_BLOCKS * ROWS:
        raise ArgumentError(f"'blocks' needs at least {LEAST_BLOCKS * ROWS} poses; found {rows}", "drift")
    return known


def _kinds(drift: bool | DriftKind | Sequence[DriftKind], allowed: Collection[DriftKind]) -> tuple[DriftKind, ...]:
    if isinstance(drift, bool):
        return ("linear",) if drift else ()
    kinds = (drift,) if isinstance(drift, str) else tuple(drift)
    for kind in kinds:
        if kind not in allowed:
            raise ArgumentError(f"expected true, false or some of {', '.join(allowed)}; found {kind!r}", "drift")
        if kind in ALONE and len(kinds) > 1:
            raise ArgumentError(f"'{kind}' stands alone; found it with {len(kinds) - 1} others", "drift")
    return () if kinds == ("none",) else kinds


def groups(word: str, numbers: np.ndarray) -> list[tuple[str, str, np.ndarray]]:
    """A column that is 1 in each group but the last, in the order of the rows."""
    each = dict.fromkeys(numbers.tolist())
    return [(f"{word}_{k:g}", "", (numbers == k).astype(float)) for k in each if k != numbers[-1]]


def _row(values: ArrayLike, count: int, name: str) -> np.ndarray:
    row = np.asarray(values, float)
    if row.shape != (count,) or not np.all(np.isfinite(row)):
        raise ArgumentError(f"expected {count} finite numbers, one per pose; found the shape {row.shape}", name)
    return row
