"""Kind "dynamic_stiffness": the shipped problem, records named by an index, and what is refused, with its key."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus
from gtmodel.results.as_json import plain
from gtmodel.robots.kuka import table_16
from gtmodel.vibration import dynamic_stiffness_study
from gtmodel.vibration.dynamic_stiffness import Process, SyntheticArm, synthetic_experiments

PROBLEM = "problems/dynamic_stiffness_kr500.toml"
SMALL = ("synthetic.poses=12", 'synthetic.records="receptance"', "process.starts=1")


def solved(*changes: str):
    return answer(load(PROBLEM, list(changes)), Context())


def test_the_shipped_problem_with_fewer_poses_gives_what_the_call_gives() -> None:
    found = solved(*SMALL)
    assert found.status is SolveStatus.SOLVED and len(found.mass) == 36 and found.rows
    made = synthetic_experiments(table_16(), SyntheticArm(seed=16, poses=12, records="receptance"))
    called = dynamic_stiffness_study(made, process=Process(starts=1))
    assert plain(found.values) == plain(called.values)


def measured(folder, poses: int, index: str = "hits.csv"):
    f = np.arange(1.0, 100.0, 0.25)
    s = 2j * np.pi * f
    rows = ["x [mm],y [mm],z [mm],A [deg],direction,file"]
    for n in range(poses):
        H = 1 / ((200.0 + 10 * n) * s**2 + 4000.0 * s + 3e6)
        table = np.column_stack([f, H.real, H.imag])
        head = "frequency [Hz],real [m/N],imaginary [m/N]"
        np.savetxt(folder / f"{n}.csv", table, "%.15g", ",", header=head, comments="")
        rows += [f"{100 * n},{-2400 - 50 * n},300,{10 * n},{d},{n}.csv" for d in "xyz"]
    (folder / "hits.csv").write_text("\n".join(rows) + "\n")
    path = folder / "own.toml"
    path.write_text(f'kind = "dynamic_stiffness"\n[process]\nstarts = 1\n[measured]\nindex = "{index}"\n')
    context = Context(folder=folder)
    return answer(load(path), context), context


def test_files_are_read_beside_the_problem_and_entered(tmp_path) -> None:
    found, context = measured(tmp_path, 8)
    np.testing.assert_allclose(found.mass[::3], 200.0 + 10 * np.arange(8), rtol=1e-6)
    assert {"measured.index", "3.csv"} <= set(context.inputs)


@pytest.mark.parametrize(("poses", "index", "key"), [(1, "hits.csv", "measured.index"), (1, "no", "measured.index")])
def test_wrong_records_name_their_key(tmp_path, poses, index, key) -> None:
    with pytest.raises(InputError) as caught:
        measured(tmp_path, poses, index)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (("measured.index='a.csv'",), "synthetic"),
        (("fit.search_Hz=[9.0, 3.0]", *SMALL), "fit.search_Hz"),
        (("synthetic.box_deg=[9.0, 3.0]",), "synthetic.box_m"),
        (('map.over=["y", "y"]', *SMALL), "map.over"),
        (("fit.search_Hz=[150.0, 190.0]", *SMALL, "synthetic.poses=8", "fit.modes=1"), "synthetic"),
    ],
)
def test_wrong_problems_name_their_key(changes, key) -> None:
    with pytest.raises(InputError) as caught:
        solved(*changes)
    assert caught.value.key == key


def test_explain_says_what_is_synthetic() -> None:
    text = explain(load(PROBLEM), Context())
    assert "180 SYNTHETIC, seed 16" in text and "nine distinct rows" in text
