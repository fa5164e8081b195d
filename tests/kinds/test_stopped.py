"""Some kinds stopped at one of their first asks, as a proof every kind at each: a study that is shown and written."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from gtmodel.problem_files import Context, names
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import solve
from gtmodel.results import SolveStatus, Study

KINDS = [kind for kind in names() if kind != "codegen"]  # codegen is stopped in tests/test_cli.py
SHORTER: dict[str, tuple[str, ...]] = {
    "calibration": ("calibrate_delta",), "learning_control": ("learning_case_1", "learning.iterations=2"),
    "modes": ("dietmaier_modes",), "simulation": ("stick_slip",), "trajectory_table": ("table_6_1",),
    "vibration": ("vibration_table_6_15",),
}  # fmt: skip
"""Kinds whose page begins with a long problem: a shorter one, and keys that make it short."""
CHEAP = ("compliance", "delay", "friction", "optimization", "resampling", "sensor_fusion", "simulation", "vibration")
DOCS = Path(__file__).resolve().parents[2] / "docs" / "kinds"
ASK = 2  # the first one of most studies stands before anything is made
LAST = 60  # asks of a proof


class Stopped(Context):
    """A run that is asked to end at its k-th question."""

    def __init__(self, k: int, name: str, folder: Path) -> None:
        super().__init__(name=name, folder=folder)
        self.k, self.asks = k, 0

    def _stop(self) -> bool:
        self.asks += 1
        return self.asks >= self.k


def problem_of(kind: str) -> tuple[str, ...]:
    """The first problem on the page of a kind, unless there is a shorter one, and settings."""
    page = (DOCS / f"{kind}.md").read_text(encoding="utf-8")
    return SHORTER.get(kind) or tuple(re.findall(r"^```\{problem\} (\w+)$", page, re.M)[:1])


def stopped(kind: str, k: int, out: Path) -> tuple[Stopped, Study]:
    name, *settings = problem_of(kind)
    loaded = load(f"problems/{name}.toml", settings)
    run = Stopped(k, name, loaded.path.parent)
    return run, solve(loaded, run, out=out).outcome


def asks() -> Iterator[int]:
    k = 1
    while k < LAST:
        yield k
        k += 1 + k // 8


@pytest.mark.parametrize(
    ("kind", "asked"),
    [*((kind, [ASK]) for kind in CHEAP), *(pytest.param(k, list(asks()), marks=pytest.mark.proof) for k in KINDS)],
    ids=lambda of: of if isinstance(of, str) else f"{len(of)} times",
)
def test_wherever_a_study_is_stopped_it_can_be_shown_and_written(kind: str, asked: list[int], tmp_path: Path) -> None:
    for k in asked:
        run, study = stopped(kind, k, tmp_path / str(k))
        assert study.status is SolveStatus.INTERRUPTED or run.asks < k or study.status.ok
        assert str(study) and all(study.figure(figure) for figure in study.figures)
        if run.asks < k:
            break


def test_a_law_that_has_learned_nothing_yet_is_kept(tmp_path: Path) -> None:
    """A trajectory of no signals was asked for where a stop came before the first run of learning."""
    kept = [stopped("learning_control", k, tmp_path / str(k))[1] for k in (7, 8)]
    assert [s.status for s in kept] == [SolveStatus.INTERRUPTED] * 2 and all(s.trajectory is None for s in kept)
    assert [len(s.values["axes"]) for s in kept] == [1, 2] and all(map(str, kept))


def test_gain_limits_are_kept_when_the_worst_case_is_not_waited_for(tmp_path: Path) -> None:
    _, s = stopped("delayed_feedback", 3, tmp_path / "out")
    assert s.status is SolveStatus.INTERRUPTED and set(s.values["limit"]) == {"x", "y"}
    assert s.values["recommended"] is None and str(s)
