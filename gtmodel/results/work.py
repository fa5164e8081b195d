"""What a long computation reports meanwhile, when it is to stop, and the decorator by which every argument of a
study is checked before work begins."""

from __future__ import annotations

import inspect
import math
import signal
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import MISSING, dataclass, field, fields
from functools import cache, wraps
from typing import Annotated, Any, ParamSpec, Protocol, TypedDict, TypeVar, get_type_hints

from .agreement import Within, agree
from .status import SolveStatus
from .study import Study

SOON = 1e-9  # s: what is left of a time limit that was over before the study began


class Progress(Protocol):
    """Shows how far the work is: what is being done, the fraction done from 0 to 1 if known, and numbers."""

    def __call__(
        self,
        stage: str | None = None,
        fraction: float | None = None,
        numbers: Mapping[str, float] | None = None,
    ) -> object: ...


class Interrupted(Exception):
    """The work was to end before or within this step; the study is what it kept by `Work.keep`, or its status alone."""


KEPT: ContextVar[list[Callable[[], Any]]] = ContextVar("KEPT")  # of the study that runs; `study_function` opens it


def silent(stage: str | None = None, fraction: float | None = None, numbers: Mapping[str, float] | None = None) -> None:
    """Shows nothing."""


def never() -> bool:
    """No stop is asked for."""
    return False


@dataclass(frozen=True, kw_only=True)
class Work:
    """Title, progress and end of one run; made of the arguments that every study takes.

    title: of tables and pictures; the study's own if empty.
    progress: called as progress(stage, fraction, numbers): what is being done, the fraction done from 0 to 1 or None,
        and numbers by name or None.
    max_seconds: time limit [s] from the making of this object on; None for none.
    stop: asked once per step of the work; True ends it with what there is.
    """

    title: str = ""
    progress: Progress = silent
    max_seconds: Annotated[float | None, Within(above=0.0)] = None
    stop: Callable[[], bool] = never
    began: float = field(default_factory=time.monotonic)

    def keep(self, so_far: Callable[[], Any]) -> None:
        """Say what the study is if it is ended from now on: `so_far` makes it of what there is then."""
        KEPT.get([]).append(so_far)

    def step(self, stage: str, fraction: float | None = None) -> None:
        """Tell of a step that asks nothing meanwhile, such as the making of a model; raises Interrupted if asked to
        end. A study that ends this way has the values that it kept."""
        if self.interrupted():
            raise Interrupted(f"stopped before {stage}")
        self.progress(stage, fraction)

    def interrupted(self) -> bool:
        """True once a stop was asked for or the time is over; engines ask once per iteration."""
        return self.stop() or self.seconds_left() == 0.0

    def fractions(self, stage: str) -> Callable[[float], bool]:
        """What a long loop calls with the fraction done; True ends it."""

        def progress(fraction: float) -> bool:
            self.progress(stage, fraction)
            return self.interrupted()

        return progress

    def iterations(self, stage: str) -> Callable[[int, float, float], bool]:
        """What an optimiser calls once per iteration, with objective and constraint violation; True ends it."""

        def progress(iteration: int, objective: float, violation: float) -> bool:
            self.progress(stage, None, {"iteration": iteration, "objective": objective, "violation": violation})
            return self.interrupted()

        return progress

    def seconds_left(self) -> float | None:
        """Time left [s], never negative; None without a limit."""
        if self.max_seconds is None:
            return None
        return max(0.0, self.max_seconds - (time.monotonic() - self.began))


class WorkOptions(TypedDict, total=False):
    """The arguments that every study takes, by keyword, with the meaning and the defaults that `Work` gives them."""

    title: str
    progress: Progress
    max_seconds: float | None
    stop: Callable[[], bool]


@dataclass(kw_only=True)
class RunClock:
    """When a run is to end, and whether it asks for that: what a watchdog in a signal handler looks at.

    max_seconds: time limit [s] from the making of the clock on; None for none.
    ends: when the run is to end, by its limit or as it was asked; asked: when it last asked for that [s of monotonic].
    running: true while a study may be ended within a step that does not ask.
    """

    progress: Progress = silent
    max_seconds: float | None = None
    stop_requested: bool = False
    began: float = field(default_factory=time.monotonic)
    ends: float = math.inf
    asked: float = -math.inf
    running: bool = False

    def __post_init__(self) -> None:
        if self.max_seconds is not None:
            self.ends = self.began + self.max_seconds

    def request_stop(self) -> None:
        """Ask the running solve to end with its best iterate, as Ctrl-C does."""
        self.stop_requested, self.ends = True, min(self.ends, time.monotonic())

    def overdue(self) -> bool:
        """True while a study runs that was to end and has not asked since."""
        return self.running and self.asked < self.ends <= time.monotonic()

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """While a study runs, which may be ended within a step that does not ask."""
        before, self.running = self.running, True
        try:
            yield
        finally:
            self.running = before

    def _stop(self) -> bool:
        self.asked = time.monotonic()
        return self.stop_requested

    def clock(self) -> Work:
        """Progress and end of the run."""
        return Work(progress=self.progress, max_seconds=self.max_seconds, stop=self._stop, began=self.began)

    def work(self) -> dict[str, Any]:
        """What every study takes of it: progress, max_seconds, stop."""
        clock = self.clock()
        left = clock.seconds_left()
        return {
            "progress": clock.progress,
            "max_seconds": left if left is None else max(left, SOON),
            "stop": clock.stop,
        }


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


P = ParamSpec("P")
R = TypeVar("R")


def ended(kind: type[R], message: str, title: str = "") -> R:
    """An interrupted study without values: of its own class, or a plain one where that class cannot be without them."""
    needed = [f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]  # type: ignore[arg-type]
    made: Any = kind if needed == ["status"] else Study
    return made(status=SolveStatus.INTERRUPTED, message=message, title=title)


def study_function(function: Callable[P, R]) -> Callable[P, R]:
    """A study whose arguments are checked against their annotations: kinds, words, `Long`, `Within`.

    It takes those of `Work` as `**work_options: Unpack[WorkOptions]`; `inspect.signature` and `get_type_hints` show
    them one by one. The other annotations are read at the first call. An argument that does not agree is an
    ArgumentError with its name. A study that is ended at a `Work.step`, or within one that asks too late, is what was
    kept by `Work.keep`, or that status alone.
    """
    own = inspect.signature(function)
    named = [p for p in own.parameters.values() if p.kind is not p.VAR_KEYWORD]
    of_work = _of_work() if len(named) < len(own.parameters) else []
    signature = own.replace(parameters=named + of_work)

    @cache
    def hints() -> dict[str, Any]:
        return get_type_hints(checked, include_extras=True)

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(f"{function.__name__}() {error}") from None
        for name, value in given.items():
            agree(value, hints()[name], name)
        kept: list[Callable[[], R]] = []
        opened = KEPT.set(kept)
        try:
            return function(*args, **kwargs)
        except Interrupted as stopped:
            if kept:
                return kept[-1]()
            return ended(hints()["return"], str(stopped), given.get("title", ""))
        finally:
            KEPT.reset(opened)

    checked.__signature__ = signature  # type: ignore[attr-defined]
    annotations = {p.name: p.annotation for p in of_work}
    checked.__annotations__ = {n: h for n, h in function.__annotations__.items() if n != "work_options"} | annotations
    return checked


@cache
def _of_work() -> list[inspect.Parameter]:
    """The parameters that every study takes."""
    hints, parameters = get_type_hints(Work, include_extras=True), inspect.signature(Work).parameters
    return [parameters[name].replace(annotation=hints[name]) for name in WorkOptions.__annotations__]
