"""What holds for all tests."""

from __future__ import annotations

import gc

import pytest

from tests.shaking import pytest_addoption, pytest_configure, pytest_report_header

__all__ = ["pytest_addoption", "pytest_configure", "pytest_report_header"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The notebooks first: what takes longest would keep one process waiting for the other at the end."""
    items.sort(key=lambda item: item.path.name != "test_notebooks.py")


def pytest_collection_finish() -> None:
    """Some thousand collected tests need no searching for garbage at every turn of the collector."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
