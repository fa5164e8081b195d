"""Whether a motion is larger than the absolute tolerance that it was integrated with."""

from __future__ import annotations

from ..results.check import Check

# of the largest state: an absolute tolerance above it leaves errors of percents
COARSE = 1e-3
# in nominals: states below are rest and round-off
REST = 1e-13


def resolution(largest: float, tolerance: float) -> dict[str, Check]:
    """The check "resolution" of a run whose states stay below COARSE; none for larger ones, and none at rest.

    largest: of any state at any time, in nominals, as the tolerance is.
    """
    if not REST < largest < COARSE:
        return {}
    advice = "declare the nominal sizes of the variables, or use a smaller tolerance"
    return {"resolution": Check(tolerance / largest, COARSE, advice)}


def unresolved(checks: dict[str, Check]) -> str:
    """A sentence for a motion that is not resolved; else an empty one."""
    check = checks.get("resolution")
    if check is None or check.passed:
        return ""
    return f"the tolerance is {check.value:.2g} of the largest state, more than {check.bound:g}: {check.advice}"
