"""What `make test` runs of tests that are many and alike: a stated part, the rest in `make proof`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import pytest


def a_fifth(items: Sequence[Any], name: Callable[[Any], str]) -> list[Any]:
    """All of them as parameters: the first, the sixth and so on at every run, the others marked proof.

    Pages call what tests of the libraries call too, so that a fifth finds what breaks them all.
    """
    return [pytest.param(x, id=name(x), marks=() if k % 5 == 0 else pytest.mark.proof) for k, x in enumerate(items)]
