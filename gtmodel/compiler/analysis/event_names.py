"""Names of a model's events, by which a person gives their order."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from ...lang.source import SourceLocation
from .events import FlatEvents, Logic


@dataclass(frozen=True, eq=False)
class NamedEvent:
    """A condition that acts when it becomes true (`when`: its number), or a switch (`mode`: its number)."""

    name: str
    logic: Logic
    where: SourceLocation
    when: int | None = None
    mode: int | None = None

    def shown(self, events: FlatEvents) -> str:
        """Its name, its line and its condition."""
        return f"{self.name} ({self.where}): {text_of(self.logic, events)}"


def named_events(events: FlatEvents) -> dict[str, NamedEvent]:
    """All of a model by name: "event 1" of gt.when, "If 1" of gt.If, "sign() 1", in the order of their lines."""
    named = {w.name: NamedEvent(w.name, w.logic, w.where, when=n) for n, w in enumerate(events.whens)}
    count: Counter[str] = Counter()
    for n, m in enumerate(events.modes):
        count[m.name] += 1
        name = f"{m.name} {count[m.name]}"
        named[name] = NamedEvent(name, m.logic, m.where, mode=n)
    return named


def listing(events: FlatEvents) -> str:
    """All events with their lines and conditions."""
    return "; ".join(e.shown(events) for e in named_events(events).values())


def comparisons_in(logic: Logic) -> list[int]:
    """Numbers of the comparisons in a condition."""
    operation, *parts = logic
    if operation == "atom":
        return [parts[0]]
    return [] if operation == "sample" else [n for part in parts for n in comparisons_in(part)]


def samples_in(logic: Logic) -> list[int]:
    """Numbers of the samples in a condition."""
    operation, *parts = logic
    if operation == "sample":
        return [parts[0]]
    return [] if operation == "atom" else [n for part in parts for n in samples_in(part)]


def text_of(logic: Logic, events: FlatEvents) -> str:
    """A condition as it reads."""
    operation, *parts = logic
    if operation == "atom":
        return events.comparisons[parts[0]].text
    if operation == "sample":
        return "gt.initial()" if events.samples[parts[0]].period is None else "gt.sample()"
    texts = [text_of(part, events) for part in parts]
    if operation == "not":
        return f"~({texts[0]})"
    return f" {'&' if operation == 'and' else '|'} ".join(f"({t})" for t in texts)
