"""What a comparison of generated C with Python found."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One named check. `passed` compares `value` with `bound`, which `detail` explains."""

    name: str
    value: float
    bound: float
    passed: bool
    detail: str = ""
    least: bool = False  # the bound is one that the value must reach

    def __str__(self) -> str:
        verdict = "passed" if self.passed else "FAILED"
        word = "at least" if self.least else "at most"
        return (
            f"{self.name}: {self.value:g} ({word} {self.bound:g}) {verdict}{': ' if self.detail else ''}{self.detail}"
        )


def at_most(name: str, value: float, bound: float = 0, detail: str = "") -> Check:
    """A check that holds when the value is not above the bound."""
    return Check(name, value, bound, value <= bound, detail)


def at_least(name: str, value: float, bound: float, detail: str = "") -> Check:
    """A check that holds when the value is not below the bound."""
    return Check(name, value, bound, value >= bound, detail, least=True)


@dataclass(frozen=True)
class CheckReport:
    """All checks of one folder. `message` is one sentence; `rows` and `rows_ok` count compared points by function."""

    checks: tuple[Check, ...]
    message: str
    rows: dict[str, int]
    rows_ok: dict[str, int]

    @property
    def passed(self) -> bool:
        """True when every check passed."""
        return all(c.passed for c in self.checks)

    def __str__(self) -> str:
        return "\n".join([self.message, *map(str, self.checks)])


def conclude(checks: list[Check], rows: dict[str, int], rows_ok: dict[str, int]) -> CheckReport:
    """A report with the sentence that its checks imply."""
    failed = [c for c in checks if not c.passed]
    if failed:
        message = f"{len(failed)} of {len(checks)} checks failed, first {failed[0]}"
    else:
        message = (
            f"the C code equals Python bit for bit at {sum(rows_ok.values())} points, "
            f"and in the status at {sum(rows.values())}"
        )
    return CheckReport(tuple(checks), message, rows, rows_ok)
