"""Signals and processes that are started: the parent answers for all."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def parents_signals() -> Iterator[None]:
    """A process that is started meanwhile never gets what asks to stop: the parent answers for all. Batch systems send
    it to the whole group, to workers too that are still starting."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
