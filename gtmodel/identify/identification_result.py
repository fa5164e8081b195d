"""Result of an identification: estimates with intervals and tests, published numbers and closed-loop runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from .._lazy import hint
from ..results import Quantity, Row, Study

if TYPE_CHECKING:
    from .closed_loop import ClosedLoopRun
    from .inertia import Identification
else:
    ClosedLoopRun = hint("gtmodel.identify.closed_loop", "ClosedLoopRun")
    Identification = hint("gtmodel.identify.inertia", "Identification")

Array = np.ndarray
Numbers = Mapping[str, float]
LOOP = "null without a closed loop"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class IdentificationStudy(Study):
    """Estimates of masses, friction or other free parameters; all None if the study stopped before the fit.

    `fit` is the fit with its rows, residuals and tests; `numbers` are published numbers of the estimated parameters;
    `closed_loop` holds the simulated recordings.
    """

    draws_residuals: ClassVar[bool] = True

    parameters: Annotated[Numbers | None, "estimates by name, in SI units"] = None
    units: Annotated[Mapping[str, str] | None, "their units"] = None
    intervals: Annotated[
        Mapping[str, Sequence[float]] | None,
        "95 % intervals by name; parameters at a bound have none",
    ] = None
    at_bound: Annotated[
        Sequence[str] | None, "names held at zero because their estimates would be negative"
    ] = None  # fmt: skip
    corrections: Annotated[
        Numbers | None, "estimated delays, scales and offsets of the signals by name, in SI units"
    ] = None
    confidence: Annotated[
        str | None, "assumption of the intervals about the residuals: white, newey_west"
    ] = None  # fmt: skip
    noise: Annotated[
        Array | None, "standard deviation of the residuals, by target, in SI units"
    ] = None  # fmt: skip
    residual_share: Annotated[Array | None, "rms residual over rms measured effort, by target"] = None
    held_out_rms: Annotated[
        Array | None,
        "rms error on held-out motions, by target, in SI units; null without held-out motions",
    ] = None
    held_out_share: Annotated[Array | None, "rms error on held-out motions over the rms of their efforts"] = None
    left_out_in_turn: Annotated[
        Array | None, "cross-validation rms error of the rows, by target, in SI units; null without `folds`"
    ] = None
    row_count: Annotated[int | None, Quantity("", "fitted rows", key="rows")] = None
    dropped_share: Annotated[float | None, "share of the samples dropped near standstill"] = None
    rows_left_out: Annotated[
        int | None, "rows of the logs dropped because they lack a number, are late or repeat, or lie between gaps"
    ] = None
    cutoff: Annotated[float | None, Quantity("Hz", "of the zero-phase low pass")] = None
    condition: Annotated[
        float | None,
        "condition number of the weighted regressor, columns scaled by nominal values (0: least of its unit)",
    ] = None
    base_parameters: Annotated[
        Mapping[str, Mapping[str, float]] | None,
        "base parameters of a serial arm: the terms of each with their factors; null unless inertias are identified",
    ] = None
    masses: Annotated[
        Array | None, Quantity("kg", "masses of physically consistent bodies with these base parameters, by link")
    ] = None  # fmt: skip
    first_moments: Annotated[Array | None, Quantity("kg.m", "mass times centre of mass, by link, link frames")] = None
    inertias: Annotated[
        Array | None, Quantity("kg.m2", "their inertias, xx, xy, xz, yy, yz, zz, about the origins of the link frames")
    ] = None  # fmt: skip
    left_out: Annotated[
        Numbers | None,
        "p-value of each watched group of fixed parameters: small if the residuals contain their effect",
    ] = None
    delay: Annotated[
        Sequence[float] | None,
        Quantity(
            "s", "delay of the efforts relative to the positions, and its standard deviation; null if undetermined",
            written="ms",
        ),
    ] = None  # fmt: skip
    by_recording: Annotated[
        Mapping[str, Mapping[str, Sequence[float]]] | None,
        "95 % intervals by name from each recording alone, held-out ones included; null with one recording",
    ] = None
    between_recordings: Annotated[
        Numbers | None,
        "standard deviation by name between recordings beyond their noise, in SI units; null if they agree",
    ] = None
    truth: Annotated[Numbers | None, "true values of a synthetic plant; null for measured logs"] = None
    coverage: Annotated[
        Mapping[str, Any] | None,
        "number of intervals that contain the truth, by name, over the runs; pooled share and band; null without runs",
    ] = None
    synthetic: Annotated[
        str | None, "seed and noise of a synthetic log; null for a measured one"
    ] = None  # fmt: skip
    published: Annotated[
        Numbers | None,
        "relative difference of the estimates from published numbers, by name; null without published numbers",
    ] = None
    closed_loop_rms: Annotated[
        Sequence[float] | None,
        f"rms error of the simulated motion by recording, in the unit of the position; {LOOP}",
    ] = None
    closed_loop_maximum: Annotated[
        Sequence[float] | None, f"largest absolute error of the simulated motion, by recording; {LOOP}"
    ] = None  # fmt: skip
    closed_loop_relative: Annotated[
        Sequence[float] | None,
        f"rms error of the simulated motion over the standard deviation of the measured one, by recording; {LOOP}",
    ] = None
    closed_loop_effort: Annotated[
        Sequence[float] | None,
        f"rms error of the simulated efforts over the rms of the measured ones, unfiltered; {LOOP}",
    ] = None
    fit: Identification | None = None
    numbers: Numbers | None = None
    closed_loop: Sequence[ClosedLoopRun] = ()

    @property
    def rows(self) -> list[Row]:
        """Rows of the table."""
        if self.fit is None:
            return []
        units, published = self.units or {}, self.published or {}
        rows = [*self._parameter_rows(), *self._fit_rows(self.fit)]
        if self.synthetic:
            rows.append(Row("synthetic", self.synthetic))
        for name, number in (self.numbers or {}).items():
            percent = "" if not number else f", {100 * published[name]:+.2f} %"
            rows.append(Row(f"published {name}", f"{number:g}{percent}", units.get(name, "")))
        from .closed_loop import rows_of  # here: reading a result must not import the simulation

        return rows + rows_of(self.closed_loop)

    def _parameter_rows(self) -> list[Row]:
        rows = []
        for name, value in (self.parameters or {}).items():
            truth = (self.truth or {}).get(name)
            rows.append(Row(name, value, (self.units or {})[name]))
            low, high = (self.intervals or {}).get(name, (None, None))
            comparison = "" if truth is None else f" (synthetic truth {truth:g})"
            rows.append(Row("  95 %", "at its bound" if low is None else f"{low:.5g} to {high:.5g}{comparison}"))
        for name, value in (self.corrections or {}).items():
            unit = (self.units or {}).get(name, "s" if ".delay" in name else "")
            rows.append(Row(name, value, "" if unit == "1" else unit))
            if name in (self.intervals or {}):
                low, high = (self.intervals or {})[name]
                rows.append(Row("  95 %", f"{low:.5g} to {high:.5g}"))
        return rows

    def _fit_rows(self, fit: Identification) -> list[Row]:
        rows = []
        for k, (target, unit) in enumerate(zip(fit.rows.targets, fit.rows.units_of_targets, strict=True)):
            rows.append(Row(f"noise of {target}", float(fit.noise[k]), unit))
            if self.held_out_rms is not None:
                rows.append(Row(f"held-out error of {target}", float(self.held_out_rms[k]), unit))
            if self.left_out_in_turn is not None:
                rows.append(Row(f"cross-validation error of {target}", float(self.left_out_in_turn[k]), unit))
        residuals = f"for {'coloured' if fit.confidence == 'newey_west' else 'white'} residuals"
        if self.synthetic is None:  # a measured machine may behave differently on another day
            count = len(fit.rows.starts)
            residuals += ", of this recording" if count == 1 else f", of these {count} recordings"
        rows.append(Row("intervals", residuals))
        for name, spread in (self.between_recordings or {}).items():
            ranges = "; ".join(f"{low:.5g} to {high:.5g}" for low, high in (self.by_recording or {})[name].values())
            rows.append(
                Row(f"{name} by recording", f"{ranges}; varies by {spread:.2g}", (self.units or {}).get(name, ""))
            )
        if c := self.coverage:
            hits, band = c["hits"].values(), c["band"]
            rows.append(Row("pooled coverage", 100 * c["pooled"], "%"))
            rows.append(
                Row(
                    "intervals with the truth",
                    f"{min(hits)} to {max(hits)} of {c['runs']}, band {band[0]} to {band[1]}",
                )
            )
        return [
            *rows,
            Row("zero-phase low pass at", self.cutoff, "Hz"),
            Row("rows", self.row_count),
            Row("dropped near standstill", 100 * fit.rows.dropped, "% of samples"),
        ]
