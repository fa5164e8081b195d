"""What a comparison of generated C with Python found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...results import Check
from ...results.check import failed_of, verdict


@dataclass(frozen=True)
class CheckReport:
    """All checks of one folder by name. `message` is one sentence; `rows` and `rows_ok` count compared points by
    function."""

    checks: Mapping[str, Check]
    message: str
    rows: Mapping[str, int]
    rows_ok: Mapping[str, int]

    @property
    def passed(self) -> bool:
        """True when every check passed."""
        return not failed_of(self.checks)


def check_report(checks: Mapping[str, Check], rows: Mapping[str, int], rows_ok: Mapping[str, int]) -> CheckReport:
    """A report with the sentence that its checks imply."""
    failed = failed_of(checks)
    equal = (
        f"the C code equals Python bit for bit at {sum(rows_ok.values())} points, "
        f"and in the status at {sum(rows.values())}"
    )
    return CheckReport(checks, verdict(failed, len(checks)) if failed else equal, rows, rows_ok)
