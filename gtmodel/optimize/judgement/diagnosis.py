"""What a failed solve says, and the line that it is about: the worst rows by name, element and time."""

from __future__ import annotations

import numpy as np

from ...lang.source import SourceLocation
from ...results.status import SolveStatus
from ..ipopt import SolverRun
from ..nlp import Nlp
from ..solution import horizon
from .checks import Remark, class_place, joined, not_finite, objective_place, row_place, variable_place

WORST = 3
SMALL = 1e-6  # violations below this are none
# what ended these runs is no line of the model's
LIMITS = (SolveStatus.INTERRUPTED, SolveStatus.ITERATION_LIMIT)
FAR = 1e6  # nominals: what is so far away where nothing bounds it runs away


def ended(run: SolverRun, nlp: Nlp) -> Remark:
    """One sentence on how a solve ended, with the place that it is about: of the class where a limit ended it, else of
    what is surplus, not finite, without bound or least satisfied."""
    if run.status.ok:
        return Remark(solved_word(run), objective_place(nlp.problem) if run.reservation else None)
    more = [surplus(nlp), not_finite(nlp, run.x), runaway(nlp, run.x) or worst(nlp, run)]
    own = class_place(nlp.problem)
    return failure(run, more, own if run.status in LIMITS or all(r.where is None for r in more if r) else None)


def solved_word(run: SolverRun) -> str:
    word = "solved" if run.word == "Solve_Succeeded" else "solved to the acceptable level only"
    if run.other is not None:
        other, reason = run.other
        word += f" with the {run.barrier} barrier strategy, after the {other} one failed ({_word(reason)})"
    return f"{word}: {run.reservation}" if run.reservation else word


def failure(run: SolverRun, more: list[Remark], where: SourceLocation | None = None) -> Remark:
    """The status in words, IPOPT's word, and what else is known; where: what the status itself is about."""
    tries = _word(run.word)
    if run.other is not None:
        other, word = run.other
        tries = f"{tries} with the {run.barrier} barrier strategy, {_word(word)} with the {other} one"
    said = f"{run.status.message} ({tries})"
    kept = f"kept is iterate {run.best.number}, the nearest to its constraints" if run.best else ""
    return joined([Remark(said, where), Remark(kept), *more])


def _word(word: str) -> str:
    return word if " " in word else f"IPOPT: {word}"


def surplus(nlp: Nlp) -> Remark:
    """What holds too much, where equations are more than unknowns: fixed values and equations besides the model's."""
    problem, layout, N = nlp.problem, nlp.element.layout, nlp.mesh.elements
    equal, free = int(np.sum(nlp.lbg == nlp.ubg)), int(np.sum(nlp.lbx != nlp.ubx))
    if equal <= free:
        return Remark("")
    fixed = nlp.lbx == nlp.ubx
    ends = [(range(layout.nx), "start"), (range(nlp.end, nlp.end + layout.nx), "end")]
    held = [(n, place) for at, place in ends for k, n in zip(at, problem.state_names, strict=True) if fixed[k]]
    names = [f"{n} is fixed at the {place}" for n, place in held]
    equations = [r for r in problem.points if r.low == r.high]
    names += [f"{r.label} is an equation" for r in equations]
    element = [nlp.element.row_names[r][0] for r in np.flatnonzero(nlp.element.low == nlp.element.high)]
    along = [r.label for r in problem.path if r.label in element]
    names += [f"{label} is an equation at every point" for label in dict.fromkeys(along)]
    places = [*(r.where for r in equations), *(variable_place(problem, n) for n, _ in held)]
    return Remark(
        f"{equal} equations for {free} unknowns on {N} elements: {', '.join(names)}; leave one out",
        next((p for p in places if p is not None), class_place(problem)),
    )


def runaway(nlp: Nlp, x: np.ndarray) -> Remark:
    """What has grown far beyond its nominal where no bound stops it: the objective may fall for ever there."""
    layout, problem = nlp.element.layout, nlp.problem
    unbounded = np.where(x > 0, nlp.ubx == np.inf, nlp.lbx == -np.inf)
    size = np.where(unbounded & np.isfinite(x), np.abs(x), 0.0)
    k = int(np.argmax(size)) if len(size) else 0
    if not len(size) or size[k] < FAR:
        return Remark("")
    if k >= nlp.constants:
        name, place = problem.free_names[k - nlp.constants], ""
        value = x[k] * nlp.p_scale[k - nlp.constants]
    else:
        column = (k - nlp.end) if k >= nlp.end else k % layout.size
        groups = ((problem.state_names, layout.left[: layout.nx]), (problem.state_names, layout.x),
                  (problem.control_names, layout.u), (problem.point_names, layout.z))  # fmt: skip
        own = [
            names[i] for names, columns in groups for i in np.flatnonzero(np.any(np.atleast_2d(columns) == column, 0))
        ]
        name = own[0] if own else "an element's length"
        place = f" in element {min(k // layout.size, nlp.mesh.elements - 1) + 1}"
        value = x[k] * layout.scale[column]
    return Remark(
        f"'{name}' has grown to {value:.2g}{place}, where it has no bound: bound it, or give it a larger nominal",
        variable_place(problem, name),
    )


def worst(nlp: Nlp, run: SolverRun) -> Remark:
    """The most violated rows with element and time."""
    rows = [named_row(nlp, run.x, r, v) for r, v in violated(nlp.lbg, nlp.ubg, run.g)]
    return worst_of(rows)


def worst_of(rows: list[Remark]) -> Remark:
    """Violated rows, the worst first, as one remark: about that one."""
    return Remark(f"worst rows: {'; '.join(map(str, rows))}", rows[0].where) if rows else Remark("")


def violated(low: np.ndarray, high: np.ndarray, g: np.ndarray) -> list[tuple[int, float]]:
    """(row, violation) of the worst rows."""
    violation = np.maximum(low - g, g - high)
    violation = np.where(np.isfinite(violation), violation, np.inf)
    order = np.argsort(-violation, kind="stable")[:WORST]
    return [(int(r), float(violation[r])) for r in order if violation[r] > SMALL]


def named_row(nlp: Nlp, x: np.ndarray, row: int, violation: float) -> Remark:
    """Name, element, time and violation of a row."""
    s = nlp.row_fraction(row, x)
    t0, tf = horizon(nlp, x)
    at = "" if s is None or not np.isfinite(tf - t0) else f" ({t0 + s * (tf - t0):.4g} s)"
    return Remark(f"{nlp.row_name(row)}{at} by {violation:.2g}", row_place(nlp.problem, nlp.row_label(row)))
