"""Refinement of the mesh of a motion: how far it goes, and what is kept where it ends early."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from gtmodel.motion.finer_mesh import PASSES, finer_mesh, refined
from gtmodel.results import Check, at_most

BOUND = 1e-3
MOST = 400


@dataclass(frozen=True)
class Mended:
    elements: int
    checks: dict[str, Check]
    most_elements: int = MOST


def on(elements: int, order: float, floor: float = 0.0) -> Mended:
    """An error that falls with the mesh, to a floor that no mesh mends."""
    return Mended(elements, {"error": at_most(elements**-order + floor, BOUND)})


def finer(mended: Mended) -> int | None:
    mesh = finer_mesh(mended, mended.checks, ("error",))
    return mesh and mesh.elements


def search(elements: int, again, interrupted=lambda: False) -> tuple[Mended, str, list[int]]:
    seen = []

    def counted(_, wanted):
        seen.append(wanted)
        return again(wanted)

    return *refined(again(elements), finer, counted, interrupted), seen


@pytest.mark.parametrize("order", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("elements", np.random.default_rng(4).integers(2, 20, 6))
def test_errors_that_fall_with_the_mesh_are_refined_until_they_hold(order: float, elements: int) -> None:
    mended, trouble, seen = search(int(elements), lambda n: on(n, order))
    assert mended.checks["error"].passed and not trouble
    assert seen == sorted(set(seen)) and len(seen) <= PASSES and mended.elements <= MOST


def test_an_error_that_no_mesh_mends_is_given_up_after_one() -> None:
    mended, trouble, seen = search(50, lambda n: on(n, 2.0, floor=0.1))
    assert len(seen) == 1 and mended.elements == seen[0] and not trouble and not mended.checks["error"].passed


def test_the_limit_of_the_elements_is_reached_and_not_passed() -> None:
    mended, _, seen = search(300, lambda n: on(n, 1.0))
    assert mended.elements == MOST and seen == [MOST]


def test_what_was_found_before_is_kept_where_a_finer_mesh_finds_nothing() -> None:
    mended, trouble, seen = search(5, lambda n: on(n, 2.0) if n == 5 else "it wandered off")
    assert mended.elements == 5 and trouble == "it wandered off" and len(seen) == 1


def test_an_interrupt_keeps_what_was_found() -> None:
    mended, trouble, seen = search(5, lambda n: on(n, 2.0), lambda: True)
    assert mended.elements == 5 and not trouble and not seen
