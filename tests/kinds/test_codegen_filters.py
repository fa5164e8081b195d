"""[[filters]] of kind codegen: the shipped problem, refusals by key."""

from __future__ import annotations

from pathlib import Path

import pytest

from gtmodel.kinds.codegen.kind import functions_of, write
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load

PROBLEM = "problems/fusion_controller.toml"


def test_the_shipped_filter_is_the_one_of_the_thesis(tmp_path: Path) -> None:
    problem = load(PROBLEM).problem
    (made,) = functions_of(problem, Context()).values()
    assert (made.plan.errors, sum(s.jacobian.shape[0] for s in made.plan.sensors)) == (18, 12)
    study = write(problem, Context(), tmp_path / "out")
    assert study.status.ok
    header = (tmp_path / "out" / "gt_fusion.h").read_text()
    assert "gt_status gt_fusion_pose_step(" in header and "double specific_force" not in header


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("filters=[]", "functions"),
        ("filters.0.sensors.0.delay_s=0.0005", "filters[0].period_s"),
        ("filters.0.states=['p']", "filters[0].states"),
        ("filters.0.start.deviation.p=0.0", "filters[0].start.deviation"),
        ("filters.0.noise.jerk=-1.0", "filters[0].noise.jerk"),
        ("filters.0.noise.jrk=1.0", "filters[0]"),
        ("filters.0.sensors.0.signal='zz'", "filters[0]"),
        ("filters.0.sensors.0.deviation=-1.0", "filters[0].sensors[0].deviation"),
        ("filters.0.sensors.0.density=1.0", "filters[0].sensors[0].deviation"),
        ("filters.0.sensors.1.kind='vector'", "filters[0].sensors[1].kind"),
    ],
)
def test_what_is_wrong_is_refused_at_its_key(setting: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        functions_of(load(PROBLEM, [setting]).problem, Context())
    assert caught.value.key == key
