"""When a motion fails a check that a finer mesh can mend: how fine, for how long, and what the message says."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Protocol, TypeVar

# forces that jump leave errors that fall as the square of the elements' length, smooth ones faster
ORDER = 2
SPARE = 1.2  # beyond what that order asks for
LEAST, MOST = 1.5, 4.0  # times as many elements at once
PASSES = 4
M = TypeVar("M", bound=Any)
BETTER = 0.9  # of the worst excess over a bound before: a mesh that leaves more is not what the check lacks


def missed(checks: Mapping[str, Any], mended: Iterable[str]) -> float:
    """The worst of the failed checks named in `mended`, as a multiple of its bound; 0 where none failed."""
    failed = [checks[name] for name in mended if name in checks and not checks[name].passed]
    return max(
        (MOST**ORDER if not math.isfinite(c.value) or not c.bound else c.value / c.bound for c in failed), default=0.0
    )


def finer_mesh(mesh: M, checks: Mapping[str, Any], mended: Iterable[str]) -> M | None:
    """A mesh with more elements, at most `most_elements`, where one of the checks named in `mended` failed; else None.

    mesh: a dataclass with `elements` and `most_elements`.
    """
    times = missed(checks, mended)
    if not times or mesh.elements >= mesh.most_elements:
        return None
    factor = min(max(SPARE * times ** (1 / ORDER), LEAST), MOST)
    return replace(mesh, elements=min(int(mesh.elements * factor) + 1, mesh.most_elements))


def helped(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Whether what failed on the coarser mesh is clearly nearer to its bounds on the finer one."""
    names = [name for name, check in before.items() if not check.passed]
    return missed(after, names) - 1 <= BETTER * (missed(before, names) - 1)


class Checked(Protocol):
    """What came of one mesh."""

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
    """The outcome on finer meshes, as long as a check fails that they can mend, and a sentence on what ended the
    refinement too early.

    finer: the problem on a finer mesh, None where none can help. again: the outcome there, begun from the one before,
    or a sentence that says why there is none.
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


def refinement_note(given: int, used: int, failed: Iterable[str]) -> str:
    """What the message adds where the mesh was refined: which checks failed on the given one."""
    if used == given:
        return ""
    return f" on {used} elements: on the given {given} {' and '.join(failed)} failed"


def how(solution: Any) -> str:
    """How it was solved, without what is not known of the answer."""
    return str(solution.message).removesuffix(f": {solution.reservation}" if solution.reservation else "")
