"""Where a refusal stands: the key of a file, or the argument of a call; every refusal says a sentence."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gtmodel.problem_files import InputError
from gtmodel.results import ArgumentError


def key_of_refusal(run: Callable[[], object]) -> str:
    """The key at which a problem is refused."""
    with pytest.raises(InputError) as caught:
        run()
    assert caught.value.message
    return caught.value.key


def argument_of_refusal(run: Callable[[], object]) -> str:
    """The argument at which a call is refused."""
    with pytest.raises(ArgumentError) as caught:
        run()
    assert caught.value.message
    return caught.value.argument
