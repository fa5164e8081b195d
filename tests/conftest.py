"""What holds for all tests."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from gtmodel.results.work import Crew
from tests.shaking import pytest_addoption, pytest_configure, pytest_report_header
from tests.support.math_text import keep_parsed

__all__ = ["pytest_addoption", "pytest_configure", "pytest_report_header"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The notebooks first: what takes longest would keep one process waiting for the other at the end."""
    items.sort(key=lambda item: item.path.name != "test_notebooks.py")


def pytest_collection_finish() -> None:
    """Some thousand collected tests need no searching for garbage at every turn of the collector."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 50)


@pytest.fixture(scope="session", autouse=True)
def formulas_kept() -> None:
    keep_parsed()


@pytest.fixture(scope="session")
def crew() -> Iterator[Crew]:
    """Two worker processes for all tests, as one study would keep them: to start them takes longer than a test."""
    crew = Crew(workers=2)
    yield crew
    crew.close()


BEGUN: dict[str, dict[str, Any]] = {}


@pytest.fixture(autouse=True)
def drawn_anew(request: pytest.FixtureRequest) -> None:
    """Generators of a module begin anew in each test: what it draws does not hang on the tests before it."""
    own = {n: g for n, g in vars(request.module).items() if isinstance(g, np.random.Generator)}
    begun = BEGUN.setdefault(request.module.__name__, {n: g.bit_generator.state for n, g in own.items()})
    for name, generator in own.items():
        generator.bit_generator.state = begun[name]
