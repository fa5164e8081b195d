"""Kind "vibration", model "matrices": modes of printed matrices, their signs, the nearest passive structure."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..results import ArgumentError
from gtmodel.problem_files.base import Check, InputError, Outcome, Row, at_most
from gtmodel.results import SolveStatus
from gtmodel.vibration import DefiniteForm, Modes, definite_form, modes, sign_question

from .vibration_keys import Schema
from .vibration_values import listed, pairs_of, rows_of, values

# signs of D and K that are tried for a passive structure, the printed ones first
_SIGNS = {"as printed": (1, 1), "D and K flipped": (-1, -1), "K flipped": (1, -1), "D flipped": (-1, 1)}


def solve_matrices(problem: Schema) -> Outcome:
    """Modes as printed; nothing is repaired silently."""
    given = [name for name in ("measurements", "synthetic", "matrices") if getattr(problem, name) is not None]
    if given != ["matrices"] or problem.matrices is None:
        raise InputError("expected [matrices] alone for the model 'matrices'", given[0] if given else "matrices")
    X = problem.matrices
    try:
        M, D, K = (np.array(rows, float) for rows in (X.M_kg, X.D_kg_s, X.K_N_m))
        printed = modes(M, D, K)
        signs = sign_question(M, D, K)
    except ValueError as error:
        raise InputError(str(error), "matrices") from error
    others = {name: modes(M, d * D, k * K) for name, (d, k) in _SIGNS.items()}
    chosen, definite, refused = _passive(M, D, K, others)
    words = [*printed.words, *(definite.words if definite else [refused])]
    if definite and chosen != "as printed":
        words.append(f"{chosen} is very likely meant: an inference from stability, not in print")
    found = values(
        words=words,
        frequency_Hz=printed.frequency_Hz,
        damping=printed.damping,
        poles_1_s=pairs_of(printed.poles),
        M_kg=M,
        D_kg_s=D,
        K_N_m=K,
        stable=printed.stable,
        signs=list(signs),
        definite=definite and {"signs": chosen, "M_kg": definite.M, "D_kg_s": definite.D, "K_N_m": definite.K},
    )
    rows = [
        Row("modes of det(M lambda + K) = 0", listed(printed.frequency_Hz, ".6g"), "Hz"),
        *(Row("signs", w) for w in signs),
        *(Row("said", w) for w in words),
    ]
    if definite:
        rows += [
            Row(f"nearest passive structure ({chosen}): M", rows_of(definite.M), "kg"),
            Row("D", rows_of(definite.D), "kg/s"),
            Row("K", rows_of(definite.K), "N/m"),
        ]
    return Outcome(
        status=SolveStatus.SOLVED,
        message="stable as printed" if printed.stable else "unstable as printed; see the signs",
        checks=_checks(problem, printed),
        values=found,
        rows=rows,
        figures={"poles": lambda: _figure(problem, others, definite, chosen)},
    )


def _passive(
    M: np.ndarray, D: np.ndarray, K: np.ndarray, found: dict[str, Modes]
) -> tuple[str, DefiniteForm | None, str]:
    """The first choice of signs that is stable, its passive structure, or why there is none."""
    stable = [name for name, m in found.items() if m.stable]
    if not stable:
        return "", None, "no choice of signs of D and K is stable: no passive structure is offered"
    d, k = _SIGNS[stable[0]]
    try:
        return stable[0], definite_form(M, d * D, k * K), ""
    except ArgumentError as error:
        return stable[0], None, str(error)


def _checks(problem: Schema, printed: Modes) -> dict[str, Check]:
    X = problem.matrices
    assert X is not None
    if not X.published_Hz:
        return {}
    if len(X.published_Hz) != len(printed.frequency_Hz):
        raise InputError(
            f"has {len(X.published_Hz)} modes; the matrices have {len(printed.frequency_Hz)}", "matrices.published_Hz"
        )
    error = float(np.abs(np.sort(X.published_Hz) - printed.frequency_Hz).max())
    return {"published_Hz": at_most(error, X.published_digits_Hz)}


def _figure(problem: Schema, found: dict[str, Modes], definite: DefiniteForm | None, chosen: str) -> Any:
    from gtmodel.plot.vibration import poles_figure

    shown = {name: found[name].poles for name in dict.fromkeys(["as printed", chosen]) if name}
    if definite:
        shown["nearest passive structure"] = modes(definite.M, definite.D, definite.K).poles
    return poles_figure(shown, found["as printed"].frequency_Hz, title=problem.title or "poles")
