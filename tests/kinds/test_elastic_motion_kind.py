"""Kind "elastic_motion": keys of the file, and where refusals stand in it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus

PROBLEM = "problems/elastic_l1.toml"


def solved(*changes: str):
    return answer(load(PROBLEM, list(changes)), Context())


def test_the_shipped_problem_is_solved() -> None:
    found = solved()
    assert found.status is SolveStatus.SOLVED and found.elements == 40 and found.rows
    assert list(found.values) == ["motions", "frequency_Hz", "static_mm", "elements", "resimulated_end_mm"]


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ('robot="f1"', "inertia"),
        ('robot="d1_six_link"', "inertia"),
        ("goal.tcp_m=[0.9, -0.9, 9.0]", "goal.tcp_m"),
        ("goal.tcp_m=[0.0, -0.9, 0.1]", "goal.tcp_m"),
        ("tool.frequency_Hz=1e6", "tool.frequency_Hz"),
        ("tool.damping=1.5", "tool.damping"),
        ("limits.force_N=0", "limits.force_N"),
        ("mesh.elements=1001", "mesh.elements"),
    ],
)
def test_what_cannot_be_planned_names_its_key(change, key) -> None:
    with pytest.raises(InputError) as caught:
        solved("mesh.elements=24", change)
    assert caught.value.key == key


def test_another_family_of_robots_is_refused() -> None:
    loaded = load(PROBLEM, ['robot="f1"'])
    other = replace(loaded, problem=loaded.problem.model_copy(update={"inertia": None}))
    with pytest.raises(InputError) as caught:
        answer(other, Context())
    assert caught.value.key == "robot"


def test_explain_says_what_is_assumed() -> None:
    text = explain(load(PROBLEM), Context())
    assert "5 kg on a spring, 6 Hz" in text and "follows its motion exactly" in text
