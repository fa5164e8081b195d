"""Suspicions about data: outcomes of the tests of a run, and those that are alarms at a common significance level."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

from .check import Check, at_least, bound_in_words
from .quantity import split
from .refusal import ArgumentError

# probability that a run on clean data raises any alarm, over all its tests; the documentation promises 2 %
RUN_LEVEL = 0.01
TESTS = 10  # assumed number of tests of a run, for decisions before all are known: first step of Holm's procedure
FIRST = RUN_LEVEL / TESTS
# names of the tests on the data of every run, gtmodel.measurements.inspection.data_tests
EveryAlarm = Literal["copied_rows"]
EVERY = get_args(EveryAlarm)


@dataclass(frozen=True)
class Suspicion:
    """Outcome of one test of the data, whether it found something or not.

    name: name of the check, and word for `accept`, such as "drift".
    evidence: a sentence with the numbers, shown if the suspicion is an alarm.
    p: probability that clean data give evidence as strong as this; 0 if clean data cannot show it at all, 1 for an
        effect too small to matter. NaN, for too little data to test, raises no alarm.
    remedy: what to do about it.
    """

    name: str
    evidence: str
    p: float = 0.0
    remedy: str = ""

    @property
    def sentence(self) -> str:
        """Evidence and remedy."""
        return f"{self.evidence}; {self.remedy}" if self.remedy else self.evidence

    @property
    def refusal(self) -> str:
        """The sentence, and how to accept it."""
        return f'{self.sentence}; if it is right, accept = ["{self.name}"]'


@dataclass(frozen=True, eq=False)
class Inspection:
    """Refuses suspicious data of a run. `accepted`: names of suspicions that become notes; `notes`: these notes."""

    accepted: Collection[str] = ()
    notes: list[str] = field(default_factory=list)

    def refuse(self, suspicion: Suspicion | None, argument: str) -> None:
        """Raises ArgumentError for an alarm, with the way to accept it; notes an accepted alarm. Does nothing for None
        and for a p of FIRST or more, which no outcome of the other tests can turn into an alarm."""
        if suspicion is None or not suspicion.p < FIRST:
            return
        if suspicion.name not in self.accepted:
            raise ArgumentError(suspicion.refusal, argument)
        note = f"accepted ({suspicion.name}): {suspicion.sentence}"
        if note not in self.notes:
            self.notes.append(note)


def alarms(outcomes: Sequence[Suspicion], level: float = RUN_LEVEL) -> list[Suspicion]:
    """Return the suspicions that are alarms, strongest first; clean data raise any with probability `level`.

    One call needs all tests of a run, also those that found nothing. Source: Holm 1979, Scand. J. Statist. 6.

    >>> from gtmodel.results.suspicion import Suspicion, alarms
    >>> drift = Suspicion("drift", "the bias moves by 2 N", 1e-6, "estimate a drift")
    >>> colour = Suspicion("colour", "neighbours have a correlation of 0.1", 0.008, "average fewer readings")
    >>> [s.name for s in alarms([colour, drift])], [s.name for s in alarms([colour, drift] + 3 * [colour])]
    (['drift', 'colour'], ['drift'])
    """
    ordered = sorted(outcomes, key=lambda s: 1.0 if math.isnan(s.p) else s.p)
    for k, suspicion in enumerate(ordered):
        if not suspicion.p < level / (len(ordered) - k):
            return ordered[:k]
    return ordered


def accepted_checks(checks: Mapping[str, Check], accept: Collection[str]) -> tuple[dict[str, Check], list[str]]:
    """Return the checks without the failed ones that `accept` names, and sentences about those."""
    failed = [name for name, check in checks.items() if split(name)[0] in accept and not check.passed]
    sentences = []
    for name in failed:
        bare, unit = split(name)
        value = f"{checks[name].value:.4g}{unit and f' {unit}'}"
        sentences.append(f"accepted ({bare}): {value}, {bound_in_words(checks[name])}")
    return {name: check for name, check in checks.items() if name not in failed}, sentences


def suspicion_checks(
    outcomes: Sequence[Suspicion], accept: Collection[str] = (), level: float = RUN_LEVEL
) -> tuple[dict[str, Check], list[str]]:
    """Return a check for each test, its p-value with the bound of Holm's procedure, and the sentences of the alarms.

    Alarms named in `accept` are sentences only. Two suspicions of one name give one check, with the smaller p-value.
    Tests without enough data give no check.
    """
    raised = alarms(outcomes, level)
    tested = sorted((s for s in outcomes if not math.isnan(s.p)), key=lambda s: s.p)
    checks = {
        s.name: at_least(s.p, level / (len(outcomes) - min(k, len(raised))), s.remedy)
        for k, s in reversed(list(enumerate(tested)))
        if not (k < len(raised) and s.name in accept)
    }
    sentences = [f"accepted ({s.name}): {s.evidence}" if s.name in accept else s.sentence for s in raised]
    return {name: checks[name] for name in dict.fromkeys(s.name for s in outcomes) if name in checks}, sentences
