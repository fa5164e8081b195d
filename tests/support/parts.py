"""What `make test` runs of tests that are many and alike: a stated part, the rest in `make proof`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest


def a_third(items: Sequence[Any], name: Callable[[Any], str]) -> list[Any]:
    """All of them as parameters: the first, the fourth and so on at every run, the others marked proof.

    Notebooks and pages call what tests of the libraries call too, so that a third finds what breaks them all.
    """
    return [pytest.param(x, id=name(x), marks=() if k % 3 == 0 else pytest.mark.proof) for k, x in enumerate(items)]
