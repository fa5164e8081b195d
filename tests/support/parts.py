"""What `make test` runs of tests that are many and alike: a stated part, the rest in `make proof`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import pytest


def a_fifth(items: Sequence[Any], name: Callable[[Any], str], later: Collection[str] = ()) -> list[Any]:
    """All of them as parameters: the first, the sixth and so on at every run, the others marked proof.

    later: names that are left to `make proof` in any case. Pages call what tests of the libraries call too, so that a
    fifth finds what breaks them all.
    """
    now = [k % 5 == 0 and name(x) not in later for k, x in enumerate(items)]
    return [pytest.param(x, id=name(x), marks=() if n else pytest.mark.proof) for x, n in zip(items, now, strict=True)]
