"""Kind "vibration": the shipped problems, a measured log in other units, and what is refused, with its key."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus
from gtmodel.results.as_json import plain
from gtmodel.vibration import (
    Impulse,
    Physical,
    StepResponse,
    Subspace,
    matrices_study,
    step_record,
    structure_record,
    study,
    synthetic_records,
)
from tests.support.refusals import key_of_refusal
from tests.vibration.structures import FEW as OF_TWO, FORCED, HIT, OF_HIT, OF_STEPS, PRINTED, STEPS, TS, TWO, D, K, M

FEW = "synthetic.samples=3000"  # of the shipped 30000, for speed
SAME = 1e-6  # relative: a log in mm and ms, written with 17 digits, is the same log


def solved(name: str, *changes: str):
    return answer(load(f"problems/vibration_{name}.toml", list(changes)), Context())


@pytest.mark.parametrize(
    ("name", "changes"), [("two_mass", [FEW]), ("table_6_15", []), ("step", []), ("hammer", [])]
)  # fmt: skip
def test_shipped_problems_are_solved(name, changes) -> None:
    found = solved(name, *changes)
    assert found.status is SolveStatus.SOLVED and found.checks and found.rows


@pytest.mark.parametrize(
    ("name", "changes", "call"),
    [
        ("two_mass", [FEW], lambda: study(synthetic_records(TWO, OF_TWO), Subspace(), physical=FORCED, truth=TWO)),
        ("step", [], lambda: study(synthetic_records(STEPS, OF_STEPS), StepResponse(), truth=STEPS)),
        ("hammer", [], lambda: study(synthetic_records(HIT, OF_HIT), Impulse(), truth=HIT)),
        ("table_6_15", [], lambda: matrices_study(PRINTED)),
    ],
)
def test_a_file_and_a_call_give_equal_values(name, changes, call) -> None:
    assert plain(solved(name, *changes).values) == plain(call().values)


def log(path, record, names=("u", "x", "y")) -> None:
    rows = np.column_stack([1e3 * record.time, record.u, 1e3 * record.y])
    lines = ["t [ms]," + ",".join(names[: rows.shape[1] - 1])]
    path.write_text("\n".join([*lines, *(",".join(f"{x:.17g}" for x in row) for row in rows)]) + "\n")


SUBSPACE = """kind = "vibration"
model = "subspace"
[measurements]
files = ["log.csv"]
time = { column = "t", unit = "ms" }
force_N = { column = "u", unit = "N" }
position_m = { column = ["x", "y"], unit = "mm" }
[subspace]
block_rows = 10
largest_order = 6
[physical]
force_coordinates = [1]
"""


@pytest.fixture()
def measured(tmp_path):
    record = structure_record(M, D, K, force=50.0, samples=1500, sample_time=TS, noise=1e-5, seed=4, hold=8)
    log(tmp_path / "log.csv", record)

    def run(*changes: str, text: str = SUBSPACE):
        (tmp_path / "problem.toml").write_text(text)
        return answer(load(str(tmp_path / "problem.toml"), list(changes)), Context(folder=tmp_path))

    run.record, run.folder = record, tmp_path
    return run


def test_a_measured_log_in_millimetres_and_milliseconds(measured) -> None:
    found = measured()
    same = study(measured.record, Subspace(block_rows=10, largest_order=6), physical=Physical([1]))
    np.testing.assert_allclose(found.K, same.K, rtol=SAME)
    assert found.synthetic is None and "matrix_error" not in found.checks


def test_measured_steps_of_several_recordings(measured) -> None:
    for n in range(2):
        record = step_record(
            0.9656, 0.03425, 5, 1e-3 * (n + 1), samples=200, before=20, sample_time=TS, noise=5e-6, seed=n
        )
        log(measured.folder / f"step{n}.csv", record)
    text = SUBSPACE.partition("[subspace]")[0].replace('"subspace"', '"step_response"')
    text = text.replace('["log.csv"]', '["step0.csv", "step1.csv"]').replace("force_N", "reference_m")
    text = text.replace('"N"', '"m"').replace('["x", "y"]', '"x"')
    found = measured(text=text)
    assert found.delay_samples == 5 and found.a == pytest.approx(0.9656, abs=1e-3)
    assert key_of_refusal(lambda: measured("step_response.delay_samples=180", text=text)) == "step_response"


def test_a_measured_decay(measured) -> None:
    text = SUBSPACE.partition("[subspace]")[0].replace('"subspace"', '"impulse"')
    assert key_of_refusal(lambda: measured(text=text)) == "measurements"
    text = "\n".join(line for line in text.splitlines() if "force_N" not in line)
    assert key_of_refusal(lambda: measured("measurements.after_s=60.0", text=text)) == "measurements.after_s"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ('measurements.files=["no.csv"]', "measurements.files[0]"),
        ("measurements.sample_time_s=0.01", "measurements"),
        ('measurements.files=["log.csv", "log.csv"]', "measurements.files"),
        ('measurements.position_m.scale="estimate"', "measurements.position_m.scale"),
        ('measurements.position_m.unit="N"', "measurements.position_m"),
        ("subspace.order=30", "subspace"),
        ("subspace.order=3", "subspace"),
        ("subspace.block_rows=300", "subspace"),
        ("physical.force_coordinates=[3]", "physical.force_coordinates"),
        ("physical.mass=[{coordinate=4, mass_kg=1.0}]", "physical.mass[0].coordinate"),
        ('model="step_response"', "physical"),
        ('model="matrices"', "physical"),
        ("matrices={M_kg=[[1.0]], D_kg_s=[[1.0]], K_N_m=[[1.0]]}", "matrices"),
    ],
)
def test_wrong_inputs_name_their_key(measured, change, key) -> None:
    assert key_of_refusal(lambda: measured(change)) == key


def test_a_log_that_jitters_is_refused_with_its_line(measured) -> None:
    path = measured.folder / "log.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:100], *lines[101:]]) + "\n")
    with pytest.raises(
        InputError, match=r"log.csv line 101: 8 ms after the row before; expected 4 ms .* 1 sample is missing"
    ):
        measured()


def test_a_reference_is_no_force(measured) -> None:
    text = SUBSPACE.replace("force_N", "reference_m").replace('"N"', '"mm"')
    assert key_of_refusal(lambda: measured(text=text)) == "physical.force_coordinates"


@pytest.mark.parametrize(
    ("name", "change", "key"),
    [
        ("two_mass", 'model="impulse"', "physical"),
        ("hammer", 'model="step_response"', "synthetic.hit"),
        ("hammer", "synthetic.hit.damping=[0.1]", "synthetic.hit"),
        ("step", "synthetic.steps.amplitudes_m=[]", "synthetic.steps"),
        ("table_6_15", "matrices.M_kg=[[1.0]]", "matrices"),
        ("table_6_15", "matrices.published_Hz=[14.0]", "matrices.published_Hz"),
        ("two_mass", "synthetic.structure.coordinate=3", "synthetic.structure.coordinate"),
    ],
)
def test_wrong_made_up_inputs_name_their_key(name, change, key) -> None:
    assert key_of_refusal(lambda: solved(name, FEW if name == "two_mass" else 'title="t"', change)) == key


def test_explain() -> None:
    text = explain(load("problems/vibration_two_mass.toml", [FEW]), Context())
    assert "3000 samples every 4 ms, 1 inputs, 2 outputs, SYNTHETIC (seed 63, noise 1e-05 m)" in text
    assert "A_c = logm(A) / T_s" in text
    assert "det(M lambda + K) = 0" in explain(load("problems/vibration_table_6_15.toml"), Context())
