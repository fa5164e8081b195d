"""[[predictive]] of kind codegen: the shipped problem, refusals by key."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtmodel.kinds.codegen.kind import functions_of, write
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load

PROBLEM = "problems/l1_predictive.toml"


def test_the_shipped_controller_takes_accelerations_as_inputs(tmp_path: Path) -> None:
    problem = load(PROBLEM).problem
    (law,) = functions_of(problem, Context()).values()
    assert law.program.statement.causality == "inverse"
    assert [m.identifier for m in law.inputs] == ["q_m", "T_goal_m"]
    assert [m.identifier for m in law.outputs][:3] == ["tau_N", "q_m", "d_q_m_s"]
    assert write(problem, Context(), tmp_path / "out").status.ok
    assert "at most 20 iterations" in (tmp_path / "out" / "gt_l1.h").read_text()


@pytest.mark.proof
@pytest.mark.parametrize("name", [PROBLEM, "problems/predictive_path.toml"])
def test_the_code_equals_python_over_two_hundred_cycles(name: str, tmp_path: Path) -> None:
    study = write(load(name).problem, Context(), tmp_path / "out", verify=True)
    assert study.message == "the C code equals Python bit for bit at 200 points, and in the status at 200"


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("predictive=[]", "functions"),
        ("predictive.0.length_s=0.001", "predictive[0].length_s"),
        ("predictive.0.targets={}", "predictive[0].targets"),
        ("predictive.0.limits.tau=[1.0, 1.0]", "predictive[0].limits.tau"),
        ("predictive.0.measured.q.deviation=0.0", "predictive[0].measured.q.deviation"),
        ("predictive.0.outputs=['zz']", "predictive[0].outputs"),
    ],
)
def test_what_is_wrong_is_refused_at_its_key(setting: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        functions_of(load(PROBLEM, [setting]).problem, Context())
    assert caught.value.key == key
