"""Messages on how a solve ended, with the source line concerned: the worst rows by name, element and time."""

from __future__ import annotations

import numpy as np

from ...lang.source import SourceLocation
from ...results.status import SolveStatus
from ..ipopt import SolverRun
from ..nlp import Nlp
from ..solution import horizon
from .checks import Remark, class_place, joined, not_finite, objective_place, row_place, variable_place

WORST = 3
SMALL = 1e-6  # smaller violations are ignored
# these runs ended for reasons outside the model
LIMITS = (SolveStatus.INTERRUPTED, SolveStatus.ITERATION_LIMIT)
FAR = 1e6  # an unbounded unknown this many nominals from 0 diverges


def ended(run: SolverRun, nlp: Nlp) -> Remark:
    """Return one sentence on how a solve ended, with the place concerned: the class if a limit ended it, else a surplus
    equation, a term that is not finite, a diverging unknown or the worst row."""
    if run.status.ok:
        return Remark(solved_word(run), objective_place(nlp.problem) if run.reservation else None)
    causes = [surplus(nlp), not_finite(nlp, run.x), runaway(nlp, run.x) or worst(nlp, run)]
    if run.status is SolveStatus.INFEASIBLE:
        causes.append(free_end(nlp, run.at_best().x))
    place = class_place(nlp.problem)
    return failure(run, causes, place if run.status in LIMITS or all(r.where is None for r in causes if r) else None)


def free_end(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return the remark on a free final time: at its max, or the advice to start from a longer one."""
    names = nlp.problem.free_names
    if "final_time" not in names:
        return Remark("")
    k = nlp.constants + names.index("final_time")
    time, longest = (v[k] * nlp.p_scale[k - nlp.constants] for v in (x, nlp.ubx))
    text = getattr(type(nlp.problem.flat.root), "_counts_from_one", False)  # of Modelica
    if time >= longest * (1 - SMALL):
        end = "finalTime" if text else "final_time"
        return Remark(f"{end} is at its max, {longest:.4g} s: raise it if the motion may take longer")
    advice = "a longer initialGuess for finalTime" if text else "a longer guess of final_time"
    return Remark(f"the final time is free: try {advice}")


def solved_word(run: SolverRun) -> str:
    word = "solved" if run.word == "Solve_Succeeded" else "solved to the acceptable level only"
    if run.other is not None:
        other_barrier, reason = run.other
        word += f" with the {run.barrier} barrier strategy, after the {other_barrier} one failed ({_word(reason)})"
    return f"{word}: {run.reservation}" if run.reservation else word


def failure(run: SolverRun, more: list[Remark], where: SourceLocation | None = None) -> Remark:
    """Return the status in words, IPOPT's return status, and further remarks; where: the place of the status itself."""
    tries = _word(run.word)
    if run.other is not None:
        other_barrier, word = run.other
        tries = f"{tries} with the {run.barrier} barrier strategy, {_word(word)} with the {other_barrier} one"
    stopped = run.status is SolveStatus.INTERRUPTED  # the word of the run says by whom
    text = f"the run ended early: {tries}" if stopped else f"{run.status.message} ({tries})"
    iterate = f"returned iterate {run.best.number}, which has the smallest violation" if run.best else ""
    return joined([Remark(text, where), Remark(iterate), *more])


def _word(word: str) -> str:
    return word if " " in word else f"IPOPT: {word}"


def surplus(nlp: Nlp) -> Remark:
    """Return the remark on more equations than unknowns: it lists fixed values and equations from constraints."""
    problem, layout, N = nlp.problem, nlp.element.layout, nlp.mesh.elements
    equal, free = int(np.sum(nlp.lbg == nlp.ubg)), int(np.sum(nlp.lbx != nlp.ubx))
    if equal <= free:
        return Remark("")
    fixed = nlp.lbx == nlp.ubx
    ends = [(range(layout.nx), "start"), (range(nlp.end, nlp.end + layout.nx), "end")]
    held = [(n, place) for side, place in ends for k, n in zip(side, problem.state_names, strict=True) if fixed[k]]
    names = [f"{n} is fixed at the {place}" for n, place in held]
    equations = [r for r in problem.points if r.low == r.high]
    names += [f"{r.label} is an equation" for r in equations]
    element = [nlp.element.row_names[r][0] for r in np.flatnonzero(nlp.element.low == nlp.element.high)]
    along = [r.label for r in problem.path if r.label in element]
    names += [f"{label} is an equation at every point" for label in dict.fromkeys(along)]
    places = [*(r.where for r in equations), *(variable_place(problem, n) for n, _ in held)]
    return Remark(
        f"{equal} equations for {free} unknowns on {N} elements: {', '.join(names)}; remove one",
        next((p for p in places if p is not None), class_place(problem)),
    )


def runaway(nlp: Nlp, x: np.ndarray) -> Remark:
    """Return the remark on an unbounded unknown far beyond its nominal; the objective may be unbounded."""
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
        candidates = [
            names[i] for names, columns in groups for i in np.flatnonzero(np.any(np.atleast_2d(columns) == column, 0))
        ]
        name = candidates[0] if candidates else "an element's length"
        place = f" in element {min(k // layout.size, nlp.mesh.elements - 1) + 1}"
        value = x[k] * layout.scale[column]
    return Remark(
        f"'{name}' has grown to {value:.2g}{place} and has no bound there; bound it, or give it a larger nominal",
        variable_place(problem, name),
    )


def worst(nlp: Nlp, run: SolverRun) -> Remark:
    """Return the most violated rows with element and time."""
    rows = [named_row(nlp, run.x, r, v) for r, v in violated(nlp.lbg, nlp.ubg, run.g)]
    return worst_of(rows)


def worst_of(rows: list[Remark]) -> Remark:
    """Join violated rows, worst first, into one remark at the place of the first."""
    return Remark(f"worst rows: {'; '.join(map(str, rows))}", rows[0].where) if rows else Remark("")


def violated(low: np.ndarray, high: np.ndarray, g: np.ndarray) -> list[tuple[int, float]]:
    """Return (row, violation) of the worst rows."""
    violation = np.maximum(low - g, g - high)
    violation = np.where(np.isfinite(violation), violation, np.inf)
    order = np.argsort(-violation, kind="stable")[:WORST]
    return [(int(r), float(violation[r])) for r in order if violation[r] > SMALL]


def named_row(nlp: Nlp, x: np.ndarray, row: int, violation: float) -> Remark:
    """Return name, element, time and violation of a row."""
    s = nlp.row_fraction(row, x)
    t0, tf = horizon(nlp, x)
    time_text = "" if s is None or not np.isfinite(tf - t0) else f" ({t0 + s * (tf - t0):.4g} s)"
    return Remark(f"{nlp.row_name(row)}{time_text} by {violation:.2g}", row_place(nlp.problem, nlp.row_label(row)))
