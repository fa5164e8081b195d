"""Printed matrices: their modes, their signs, the nearest passive structure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..results import ArgumentError, Check, Row, SolveStatus, at_most
from ..results.door import study_function
from ..results.work import Progress, never, silent
from .definite_form import DefiniteForm, definite_form
from .modes import SIGNS, Modes, modes, sign_question
from .options import Matrices
from .vibration_result import VibrationStudy, numbers, pairs_of, rows_of

_TRIED = ("as printed", "D and K flipped", "K flipped", "D flipped")  # for a passive structure, in this order


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MatricesStudy(VibrationStudy):
    """Modes of printed matrices; nothing is repaired silently."""

    def _model_rows(self) -> list[Row]:
        rows = [
            Row(
                "modes of det(M lambda + K) = 0", numbers([] if self.frequency is None else self.frequency, ".6g"), "Hz"
            ),
            *(Row("signs", w) for w in self.signs or ()),
        ]
        d = self.definite
        if d:
            rows += [
                Row(f"nearest passive structure ({d['signs']}): M", rows_of(d["M_kg"]), "kg"),
                Row("D", rows_of(d["D_kg_s"]), "kg/s"),
                Row("K", rows_of(d["K_N_m"]), "N/m"),
            ]
        return rows


@study_function
def matrices_study(
    matrices: Matrices,
    *,
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> MatricesStudy:
    """Modes of M x'' + D x' + K x = f as printed, which signs make them stable, the nearest passive structure.

    matrices: M [kg], D [kg/s] and K [N/m], and modes [Hz] printed beside them, to be reproduced. Nothing here takes
    long enough for progress, max_seconds or stop to matter. Raises ArgumentError.

    >>> from gtmodel.vibration import Matrices, matrices_study
    >>> s = matrices_study(Matrices(M=[[2.0]], D=[[0.4]], K=[[200.0]]))
    >>> round(float(s.frequency[0]), 3), s.stable
    (1.592, True)
    """
    M, D, K = (np.array(getattr(matrices, name), float) for name in "MDK")
    try:
        printed = modes(M, D, K)
        signs = sign_question(M, D, K)
    except ValueError as error:
        raise ArgumentError(str(error), "matrices") from error
    others = {name: modes(M, d * D, k * K) for name in _TRIED for d, k in [SIGNS[name]]}
    chosen, definite, refused = _passive(M, D, K, others)
    notes = [*printed.notes, *(definite.notes if definite else [refused])]
    if definite and chosen != "as printed":
        notes.append(f"{chosen} is very likely meant: an inference from stability, not in print")
    return MatricesStudy(
        status=SolveStatus.SOLVED,
        message="stable as printed" if printed.stable else "unstable as printed; see the signs",
        title=title,
        checks=_checks(matrices, printed),
        figures={"poles": partial(_figure, others, definite, chosen, title or "poles")},
        notes=notes,
        frequency=printed.frequency_Hz,
        damping=printed.damping,
        poles=pairs_of(printed.poles),
        M=M,
        D=D,
        K=K,
        stable=printed.stable,
        signs=list(signs),
        definite=definite and {"signs": chosen, "M_kg": definite.M, "D_kg_s": definite.D, "K_N_m": definite.K},
    )


def _passive(
    M: np.ndarray, D: np.ndarray, K: np.ndarray, by_signs: dict[str, Modes]
) -> tuple[str, DefiniteForm | None, str]:
    """The first choice of signs that is stable, its passive structure, or why there is none."""
    stable = [name for name, m in by_signs.items() if m.stable]
    if not stable:
        return "", None, "no choice of signs of D and K is stable: no passive structure is offered"
    d, k = SIGNS[stable[0]]
    try:
        return stable[0], definite_form(M, d * D, k * K), ""
    except ArgumentError as error:
        return stable[0], None, str(error)


def _checks(given: Matrices, printed: Modes) -> dict[str, Check]:
    if not given.published:
        return {}
    if len(given.published) != len(printed.frequency_Hz):
        raise ArgumentError(
            f"has {len(given.published)} modes; the matrices have {len(printed.frequency_Hz)}", "matrices.published"
        )
    error = float(np.abs(np.sort(given.published) - printed.frequency_Hz).max())
    return {"published_Hz": at_most(error, given.published_digits)}


def _figure(by_signs: dict[str, Modes], definite: DefiniteForm | None, chosen: str, title: str) -> Any:
    from ..plot.vibration import poles_figure

    shown = {name: by_signs[name].poles for name in dict.fromkeys(["as printed", chosen]) if name}
    if definite:
        shown["nearest passive structure"] = modes(definite.M, definite.D, definite.K).poles
    return poles_figure(shown, by_signs["as printed"].frequency_Hz, title=title)
