"""Automatic mesh refinement of a motion that fails a check: the next mesh, when to stop, the study and its message."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

from ..results.check import failed_of

FINER = "use more mesh.elements"  # advice of checks that a finer mesh can make pass
# limits act at collocation points only; in between, forces and speeds exceed them by less than this
PEAK_SHARE = 1.01
# with forces that jump the error is of second order in the element length, with smooth forces of higher order
ORDER = 2
SPARE = 1.2  # safety factor
LEAST, MOST = 1.5, 4.0  # limits of the refinement factor per pass
PASSES = 4
M = TypeVar("M", bound=Any)
BETTER = 0.9  # refinement stops if the worst excess over a bound stays above this share of the previous one


def missed(checks: Mapping[str, Any], mended: Iterable[str]) -> float:
    """Return the worst of the failed checks named in `mended` as a multiple of its bound; 0 if none failed."""
    failed = [checks[name] for name in mended if name in checks and not checks[name].passed]
    return max(
        (MOST**ORDER if not math.isfinite(c.value) or not c.bound else c.value / c.bound for c in failed), default=0.0
    )


def finer_mesh(mesh: M, checks: Mapping[str, Any], mended: Iterable[str]) -> M | None:
    """Return a mesh with more elements, at most `most_elements`, if a check named in `mended` failed; else None.

    mesh: a dataclass with `elements` and `most_elements`.
    """
    times = missed(checks, mended)
    if not times or mesh.elements >= mesh.most_elements:
        return None
    factor = min(max(SPARE * times ** (1 / ORDER), LEAST), MOST)
    return replace(mesh, elements=min(int(mesh.elements * factor) + 1, mesh.most_elements))


def helped(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Return whether the checks that failed on the coarser mesh are clearly closer to their bounds on the finer one."""
    names = [name for name, check in before.items() if not check.passed]
    return missed(after, names) - 1 <= BETTER * (missed(before, names) - 1)


class Checked(Protocol):
    """A result on one mesh."""

    @property
    def checks(self) -> Mapping[str, Any]: ...


F = TypeVar("F", bound=Checked)
P = TypeVar("P")


def refined(
    outcome: F,
    finer: Callable[[F], P | None],
    again: Callable[[F, P], F | str],
    interrupted: Callable[[], bool],
) -> tuple[F, str]:
    """Refine while a check fails that a finer mesh can improve; return the outcome and why refinement ended early.

    finer: returns the problem on a finer mesh, None if none can help. again: solves it from the previous outcome;
    returns the new outcome, or a sentence on why it failed.
    """
    for _ in range(PASSES):
        problem = finer(outcome)
        if problem is None or interrupted():
            break
        after = again(outcome, problem)
        if isinstance(after, str):
            return outcome, after
        before, outcome = outcome, after
        if not helped(before.checks, outcome.checks):
            break
    return outcome, ""


@dataclass(frozen=True)
class OnMesh:
    """The study of a motion on one mesh, and the solutions from which the next mesh starts."""

    mesh: Any
    study: Any
    kept: Any

    @property
    def checks(self) -> Mapping[str, Any]:
        return self.study.checks


def study_on_meshes(
    solved: Callable[[Any, OnMesh | None], OnMesh], mesh: Any, mended: Iterable[str], interrupted: Callable[[], bool]
) -> Any:
    """Return the study of the mesh, or of a finer one if a check named in `mended` failed, with all iterations.

    solved: returns the result on a mesh, from that on the previous one.
    """
    first = solved(mesh, None)
    iterations = first.study.iterations or 0

    def finer(outcome: OnMesh) -> Any:
        return finer_mesh(outcome.mesh, outcome.checks, mended) if outcome.study.status.converged else None

    def again(before: OnMesh, mesh: Any) -> OnMesh | str:
        nonlocal iterations
        after = solved(mesh, before)
        iterations += after.study.iterations or 0
        return after if after.study.status.converged else f"on {mesh.elements} elements: {after.study.message}"

    outcome, trouble = refined(first, finer, again, interrupted)
    study = outcome.study
    why = refinement_note(mesh.elements, outcome.mesh.elements, failed_of(first.checks)).strip()
    message = "; ".join(filter(None, [study.message, why, trouble]))
    return study.with_(iterations=iterations, message=message, refined=outcome is not first)


def refinement_note(given: int, used: int, failed: Iterable[str]) -> str:
    """Return the addition to the message if the mesh was refined: the checks that failed on the given one."""
    if used == given:
        return ""
    return f" on {used} elements, because on the given {given} {' and '.join(failed)} failed"


def how(solution: Any) -> str:
    """Return the solution's message without its reservation."""
    return str(solution.message).removesuffix(f": {solution.reservation}" if solution.reservation else "")
