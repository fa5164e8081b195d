"""Progress and termination of long computations, and the decorator that checks the arguments of a study."""

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

SOON = 1e-9  # s: remaining time if the time limit is over before the study begins


class Progress(Protocol):
    """Shows the progress: current stage, fraction done from 0 to 1 if known, and numbers."""

    def __call__(
        self,
        stage: str | None = None,
        fraction: float | None = None,
        numbers: Mapping[str, float] | None = None,
    ) -> object: ...


class Interrupted(Exception):
    """The work ends before or within this step; the result is what `Work.keep` stored, or only a status."""


@dataclass(eq=False)
class Crew:
    """Who runs the independent rows of a study, see `gtmodel.workers`.

    used: whether rows ran elsewhere. pool: the processes, started by the first map and kept for the next.
    """

    workers: int | None = 0
    executor: Any = None
    used: bool = False
    pool: Any = None

    def close(self) -> None:
        """End the processes."""
        if self.pool is not None and self.pool.open:
            self.pool.close()


KEPT: ContextVar[list[Callable[[], Any]]] = ContextVar("KEPT")  # of the running study; set by `study_function`
CREW: ContextVar[Crew | None] = ContextVar("CREW", default=None)  # of the running study, and of those that it calls


def silent(stage: str | None = None, fraction: float | None = None, numbers: Mapping[str, float] | None = None) -> None:
    """Show nothing."""


def never() -> bool:
    """Return False: no stop is requested."""
    return False


@dataclass(frozen=True, kw_only=True)
class Work:
    """Title, progress and termination of a run: the arguments that every study takes.

    title: title of tables and pictures; the study's default if empty.
    progress: called as progress(stage, fraction, numbers): current stage, fraction done from 0 to 1 or None, and
        numbers by name or None.
    max_seconds: time limit [s] from the creation of this object; None for no limit.
    stop: called once per step of the work; True ends it with the results so far.
    workers: number of processes for independent rows, such as starts, samples or folds; 0 for this process, None for
        one per usable core. The result is the same for any number.
    executor: runs these rows instead: an object with submit(), or a Dask client; see `gtmodel.workers`.
    """

    title: str = ""
    progress: Progress = silent
    max_seconds: Annotated[float | None, Within(above=0.0)] = None
    stop: Callable[[], bool] = never
    workers: Annotated[int | None, Within(least=0)] = 0
    executor: Any = None
    began: float = field(default_factory=time.monotonic)

    def keep(self, so_far: Callable[[], Any]) -> None:
        """Set the function that makes the result if the study ends early from now on, with the values computed so far.

        The last one set counts; the study calls it when a `step` is interrupted, and may compute then.
        """
        KEPT.get([]).append(so_far)

    def step(self, stage: str, fraction: float | None = None) -> None:
        """Report a step that cannot be interrupted, such as building a model; raises Interrupted if a stop is
        requested. A study that ends here returns the values that it kept."""
        if self.interrupted():
            raise Interrupted(f"stopped before {stage}")
        self.progress(stage, fraction)

    def interrupted(self) -> bool:
        """Return True after a stop request or the time limit; engines call it once per iteration."""
        return self.stop() or self.seconds_left() == 0.0

    def fractions(self, stage: str) -> Callable[[float], bool]:
        """Return a callback for a long loop, called with the fraction done; True ends the loop."""

        def progress(fraction: float) -> bool:
            self.progress(stage, fraction)
            return self.interrupted()

        return progress

    def iterations(self, stage: str) -> Callable[[int, float, float], bool]:
        """Return a callback for an optimiser, with iteration, objective and constraint violation; True ends it."""

        def progress(iteration: int, objective: float, violation: float) -> bool:
            self.progress(stage, None, {"iteration": iteration, "objective": objective, "violation": violation})
            return self.interrupted()

        return progress

    def seconds_left(self) -> float | None:
        """Return the time left [s], never negative; None without a limit."""
        if self.max_seconds is None:
            return None
        return max(0.0, self.max_seconds - (time.monotonic() - self.began))


class WorkOptions(TypedDict, total=False):
    """Keyword arguments of every study, with the meaning and defaults of `Work`."""

    title: str
    progress: Progress
    max_seconds: float | None
    stop: Callable[[], bool]
    workers: int | None
    executor: Any


@dataclass(kw_only=True)
class RunClock:
    """Time limit and stop requests of a run, for a watchdog in a signal handler.

    max_seconds: time limit [s] from the creation of the clock; None for no limit.
    ends: time at which the run must end, from its limit or a request; asked: time of its last check [monotonic, s].
    running: True while a study may be ended within a step that does not check.
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
        """Request the running solve to end with its best iterate, as Ctrl-C does."""
        self.stop_requested, self.ends = True, min(self.ends, time.monotonic())

    def overdue(self) -> bool:
        """Return True while a study runs that had to end and has not checked since."""
        return self.running and self.asked < self.ends <= time.monotonic()

    @contextmanager
    def under_way(self) -> Iterator[None]:
        """Mark the block as a running study, which may be ended within a step that does not check."""
        before, self.running = self.running, True
        try:
            yield
        finally:
            self.running = before

    def _stop(self) -> bool:
        self.asked = time.monotonic()
        return self.stop_requested

    def clock(self) -> Work:
        """Return progress and termination of the run as `Work`."""
        return Work(progress=self.progress, max_seconds=self.max_seconds, stop=self._stop, began=self.began)

    def work(self) -> dict[str, Any]:
        """Return the keyword arguments of a study: progress, max_seconds, stop."""
        clock = self.clock()
        left = clock.seconds_left()
        return {
            "progress": clock.progress,
            "max_seconds": left if left is None else max(left, SOON),
            "stop": clock.stop,
        }


@contextmanager
def parents_signals() -> Iterator[None]:
    """Block stop signals in processes started in the block: the parent handles them. Batch systems send these signals
    to the whole process group, also to workers that are still starting."""
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
    """Return an interrupted study without values: of this class, or a plain Study if the class requires values."""
    needed = [f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]  # type: ignore[arg-type]
    study: Any = kind if needed == ["status"] else Study
    return study(status=SolveStatus.INTERRUPTED, message=message, title=title)


def study_function(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a study, to check its arguments: type, allowed words, length (`Long`), range (`Within`).

    The study takes the arguments of `Work` as `**work_options: Unpack[WorkOptions]`; `inspect.signature` and
    `get_type_hints` list them separately. Other annotations are evaluated at the first call. Raises ArgumentError for a
    wrong argument. A study that ends at a `Work.step`, or within a step that checks too late, returns what `Work.keep`
    stored, or only the status.
    """
    original = inspect.signature(function)
    named = [p for p in original.parameters.values() if p.kind is not p.VAR_KEYWORD]
    of_work = _of_work() if len(named) < len(original.parameters) else []
    signature = original.replace(parameters=named + of_work)

    @cache
    def hints() -> dict[str, Any]:
        return get_type_hints(checked, include_extras=True)

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            arguments = signature.bind(*args, **kwargs).arguments
        except TypeError as error:
            raise TypeError(f"{function.__name__}() {error}") from None
        for name, value in arguments.items():
            agree(value, hints()[name], name)
        kept: list[Callable[[], R]] = []
        opened = KEPT.set(kept)
        own = {name: arguments[name] for name in ("workers", "executor") if of_work and name in arguments}
        crew = Crew(**own) if own else CREW.get()
        before = CREW.set(crew)
        try:
            return function(*args, **kwargs)
        except Interrupted as stopped:
            if kept:
                return kept[-1]()
            return ended(hints()["return"], str(stopped), arguments.get("title", ""))
        finally:
            CREW.reset(before)
            if own and crew is not None:
                crew.close()
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
