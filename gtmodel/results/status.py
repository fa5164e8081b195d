"""Status enumerations: for functions on data (in Python and C), for whole solves, for sets of modes.

Functions on data, such as a `CausalFunction` or the generated C, return a `Status` with the value and never
raise: a bad row of an array must not lose the good rows, and a controller cannot handle exceptions.
``solve()`` and ``simulate()`` return a `SolveStatus` and raise if it is not ok, unless called with
``throw=False``. The search for all assembly modes returns a `ModesStatus`, the completeness of the set.
"""

from __future__ import annotations

import enum
from typing import Self


class NumberedStatus(enum.IntEnum):
    """Base of statuses whose integers are shared with C: a number, 0 for success, and a message."""

    message: str

    def __new__(cls, value: int, sentence: str) -> Self:
        member = int.__new__(cls, value)
        member._value_ = value
        member.message = sentence
        return member

    def __str__(self) -> str:
        return self.name

    def __format__(self, spec: str) -> str:
        return int.__format__(self, spec) if spec else self.name

    @property
    def ok(self) -> bool:
        """True for 0."""
        return self.value == 0


class Status(NumberedStatus):
    """Outcome of one evaluation of a function on data; OK is 0, the others say why there is no value.

    A single call of a `CausalFunction` returns a Status; a call with rows returns an int array of codes. C uses the
    same integers: `c_enum` and `c_sentences` generate the C code from this table. `message` is an English sentence;
    `ok` is True for OK only.

    >>> gt.Status(1)
    <Status.OUT_OF_RANGE: 1>
    >>> print(gt.Status(1))
    OUT_OF_RANGE
    >>> gt.Status.OUT_OF_RANGE.message
    'the input lies outside the range where a solution exists'
    >>> gt.Status.OK.ok, gt.Status.OUT_OF_RANGE.ok
    (True, False)
    """

    OK = 0, "the value was computed"
    OUT_OF_RANGE = 1, "the input lies outside the range where a solution exists"
    NOT_CONVERGED = 2, "the iteration did not converge within its limit"
    SINGULAR = 3, "the equations are singular at this point"
    NOT_FINITE = 4, "a number that is not finite went in or came out"
    STALE_INPUT = 5, "the input is older than the loop allows"
    WRONG_BRANCH = 6, "the iteration led to a solution on another than the wanted branch"

    @property
    def c_name(self) -> str:
        """The enumerator in the generated C, such as ``"GT_OUT_OF_RANGE"``."""
        return f"GT_{self.name}"


class _Word(enum.StrEnum):
    """A machine-readable word with a message."""

    message: str

    def __new__(cls, word: str, sentence: str) -> Self:
        member = str.__new__(cls, word)
        member._value_ = word
        member.message = sentence
        return member


class SolveStatus(_Word):
    """Outcome of a whole solve or simulation. The value is the word in ``result.json``.

    ``message`` is an English sentence; ``ok`` is True only for a solved problem whose checks passed: an
    interrupted run, or one at its iteration limit, contains its best iterate but must not be used.
    ``converged`` is True for a complete solution, whatever its checks say; a search may continue from it.

    >>> status = gt.SolveStatus.CHECK_FAILED
    >>> status.value, status.ok, status.converged
    ('check_failed', False, True)
    """

    SOLVED = "solved", "a solution was found to the requested tolerance"
    CHECK_FAILED = "check_failed", "a solution was found, but a check says that it must not be relied on"
    INFEASIBLE = "infeasible", "no point was found that satisfies all constraints"
    ITERATION_LIMIT = "iteration_limit", "the iteration limit was reached before the tolerance was"
    INTERRUPTED = "interrupted", "the run was stopped early, by the user or by its time limit"
    NOT_FINITE = "not_finite", "a function or a derivative was not a finite number"
    DIVERGED = "diverged", "the iterates or the state grew without bound"
    BAD_INPUT = "bad_input", "the input was refused before the run began"
    FAILED = "failed", "the solver stopped for another reason, given in its message"

    @property
    def ok(self) -> bool:
        """True if the problem was solved and every check passed."""
        return self is SolveStatus.SOLVED

    @property
    def converged(self) -> bool:
        """True for a complete solution, even if a check failed."""
        return self in (SolveStatus.SOLVED, SolveStatus.CHECK_FAILED)


class ModesStatus(_Word):
    """Outcome of the search for all assembly modes of a platform. The value is a machine-readable word.

    ``message`` is an English sentence; ``ok`` is True if all finite modes are known and isolated.
    """

    COMPLETE = "complete", "all 40 modes were found, and no two are the same"
    FEWER_FINITE = "fewer_finite", "all modes were found; fewer than 40 are finite, the others lie at infinity"
    MULTIPLE = "multiple", "all modes were found, but some coincide, or nearly: the platform is singular there"
    SELF_MOTION = "self_motion", "the platform can move with all lengths fixed: the modes are not finite in number"
    INCOMPLETE = "incomplete", "some paths were lost: modes may be missing"
    INTERRUPTED = "interrupted", "the search was stopped before this pose"
    BAD_INPUT = "bad_input", "the input was refused before the search began"

    @property
    def ok(self) -> bool:
        """True if all finite modes are known and isolated."""
        return self in (ModesStatus.COMPLETE, ModesStatus.FEWER_FINITE)


def c_enum() -> str:
    """Return `Status` as a C99 enumeration for a header; the text ends in a newline.

    >>> print(gt.results.c_enum().splitlines()[1])
        GT_OK = 0, /* the value was computed */
    """
    last = len(Status) - 1
    lines = [f"    {s.c_name} = {s.value}{',' if s < last else ''} /* {s.message} */" for s in Status]
    return "\n".join(["typedef enum gt_status {", *lines, "} gt_status;", ""])


def c_sentences() -> str:
    """Return the messages of `Status` as a C99 table indexed by its value, for a .c file; it ends in a newline.

    >>> print(gt.results.c_sentences().splitlines()[0])
    static const char *const gt_status_sentences[] = {
    """
    lines = [f'    "{s.message}"{"," if s < len(Status) - 1 else ""} /* {s.c_name} */' for s in Status]
    return "\n".join(["static const char *const gt_status_sentences[] = {", *lines, "};", ""])
