"""Kind "vibration": the shipped problems, a measured log in other units, and what is refused, with its key."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.kinds import vibration
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.results import SolveStatus
from gtmodel.vibration import step_record, structure_record
from tests.vibration.structures import TS, D, K, M

FEW = "synthetic.samples=3000"  # of the shipped 30000, for speed
SAME = 1e-6  # relative: a log in mm and ms, written with 17 digits, is the same log


def solved(name: str, *changes: str, folder=None):
    problem = load(f"problems/vibration_{name}.toml", list(changes)).problem
    return vibration.solve(problem, Context() if folder is None else Context(folder=folder))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def two_mass():
    return solved("two_mass", FEW)


def test_two_masses_from_their_positions(two_mass) -> None:
    v = two_mass.values
    assert two_mass.status is SolveStatus.SOLVED and list(v) == list(vibration.VALUES)
    assert v["order"] == v["order_by_gap"] == 4 and v["synthetic"] == "seed 63, noise 1e-05 m"
    np.testing.assert_allclose(v["frequency_Hz"], [5.83612, 16.80977], rtol=1e-3)
    np.testing.assert_allclose(v["M_kg"], M, atol=0.1)
    for name, (low, high) in v["intervals"].items():
        true = {"M": M, "D": D, "K": K}[name[0]][int(name[2]), int(name[4])]
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(true - middle) < 2 * half, name  # four standard deviations
    assert "M s^2 + D s + K is stable" in v["words"] and not any("identifiable" in w for w in v["words"])
    assert two_mass.checks["largest_pole"].passed and two_mass.checks["matrix_error"].bound == 1e-3
    assert all(text.startswith("# synthetic: seed 63") for text in two_mass.files.values())
    for name in ("order", "held_out", "response"):
        assert "synthetic: seed 63" in two_mass.figures[name]().get_suptitle()


def test_without_a_force_the_masses_stay_open() -> None:
    found = solved("two_mass", FEW, "physical.force_coordinates=[]")
    assert found.values["M_kg"] is None and found.values["intervals"] is None
    assert "M is not identifiable without a known force or mass; M^-1 K and M^-1 D are" in found.values["words"]
    np.testing.assert_allclose(found.values["M_inv_K_1_s2"], np.linalg.solve(M, K), rtol=5e-3)
    assert set(found.files) == {"model.toml"}


def test_a_known_mass_does_as_well() -> None:
    mass = "physical.mass=[{coordinate=1, mass_kg=30.0}]"
    found = solved("two_mass", FEW, "physical.force_coordinates=[]", mass)
    np.testing.assert_allclose(np.diag(found.values["M_kg"]), [30.0, 12.0], rtol=0.02)
    assert found.values["intervals"] is None and any(w.startswith("masses alone are") for w in found.values["words"])
    both = solved("two_mass", FEW, mass)
    assert "known masses start the output-error fit and do not bind it" in both.values["words"]


def test_printed_matrices() -> None:
    found = solved("table_6_15")
    np.testing.assert_allclose(found.values["frequency_Hz"], [13.826, 103.337], atol=5e-4)
    assert found.checks["published_Hz"].passed and found.values["stable"] is False
    assert found.values["signs"][3] == "D and K flipped: stable, poles at 14.21, 100.6 Hz"
    assert (
        found.values["definite"]["signs"] == "D and K flipped" and found.message == "unstable as printed; see the signs"
    )
    assert found.figures["poles"]().axes[0].get_title().startswith("Compliance matrices")
    wrong = solved("table_6_15", "matrices.published_Hz=[14.0, 105.0]")
    assert not wrong.checks["published_Hz"].passed


def test_steps_and_hits() -> None:
    step = solved("step")
    assert step.values["delay_samples"] == 5 and all(c.passed for c in step.checks.values())
    assert step.values["bandwidth_Hz"][0] == pytest.approx(1.43, abs=0.01)
    assert "too slow" in step.values["words"][1] and "seeds 611 to 613" in step.figures["step"]().get_suptitle()
    hit = solved("hammer")
    np.testing.assert_allclose(hit.values["frequency_Hz"], [7.4, 11.45], rtol=1e-3)
    assert hit.checks["frequency_error"].passed and "seed 64" in hit.figures["impulse"]().get_suptitle()
    assert not solved("hammer", "impulse.modes=1").checks["modes_found"].passed


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
        problem = load(str(tmp_path / "problem.toml"), list(changes)).problem
        return vibration.solve(problem, Context(folder=tmp_path))  # type: ignore[arg-type]

    run.record, run.folder = record, tmp_path
    return run


def test_a_measured_log_in_millimetres_and_milliseconds(measured) -> None:
    from gtmodel.vibration import from_known, identify_subspace, output_error, physical_form

    found = measured()
    model = identify_subspace(measured.record, block_rows=10, largest=6)
    fit = output_error(measured.record, from_known(physical_form(model.system), force=[1.0, 0.0]))
    np.testing.assert_allclose(found.values["K_N_m"], fit.model.K, rtol=SAME)
    assert found.values["synthetic"] is None and "matrix_error" not in found.checks
    # the picture of a log shows no word that it is not
    assert "synthetic" not in found.figures["order"]().get_suptitle()


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
    assert found.values["delay_samples"] == 5 and found.values["a"] == pytest.approx(0.9656, abs=1e-3)
    with pytest.raises(InputError, match=r"^step_response: a delay of 180 samples is longer than the data"):
        measured("step_response.delay_samples=180", text=text)


def test_a_measured_decay(measured) -> None:
    text = SUBSPACE.partition("[subspace]")[0].replace('"subspace"', '"impulse"')
    with pytest.raises(InputError, match=r"^measurements: expected no input: a decay has none, besides position_m"):
        measured(text=text)
    text = "\n".join(line for line in text.splitlines() if "force_N" not in line)
    with pytest.raises(InputError, match=r"^measurements.after_s: 60 s leave 0 samples of log.csv; lower it"):
        measured("measurements.after_s=60.0", text=text)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ('measurements.files=["no.csv"]', r"^measurements.files\[0\]: there is no file 'no.csv'"),
        ("measurements.sample_time_s=0.01", r"the samples are 4 ms apart; expected 10 ms"),
        ('measurements.files=["log.csv", "log.csv"]', r"^measurements.files: hold 2 recordings; .* takes one"),
        ('measurements.position_m.scale="estimate"', r"^measurements.position_m.scale: a black box does not tell it"),
        ('measurements.position_m.unit="N"', r"^measurements.position_m: "),
        ("subspace.order=30", r"^subspace: order 30 was asked for; 10 block rows of 2 outputs tell 1 to 18"),
        ("subspace.order=3", r"^subspace: the model has the order 3 and 2 outputs; .* need the order 4"),
        ("subspace.block_rows=300", r"^subspace: 1000 samples are too few for 300 block rows"),
        (
            "physical.force_coordinates=[3]",
            r"^physical.force_coordinates: found \[3\]; expected one coordinate from 1 to 2",
        ),
        ("physical.mass=[{coordinate=4, mass_kg=1.0}]", r"^physical.mass\[0\].coordinate: is 4; the model has 2"),
        ('model="step_response"', r"^physical: goes with model = 'subspace', not 'step_response'"),
        ('model="matrices"', r"^physical: goes with model = 'subspace'"),
        ("matrices={M_kg=[[1.0]], D_kg_s=[[1.0]], K_N_m=[[1.0]]}", r"^matrices: expected one of \[measurements\] and"),
    ],
)
def test_wrong_inputs_name_their_key(measured, change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        measured(change)


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
    with pytest.raises(InputError, match=r"^physical.force_coordinates: the input is no force in newtons"):
        measured(text=text)


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("two_mass", 'model="impulse"', r"^physical: goes with"),
        ("hammer", 'model="step_response"', r"^synthetic.hit: the model 'step_response' needs \[synthetic.steps\]"),
        ("hammer", "synthetic.hit.damping=[0.1]", r"^synthetic.hit: 2 frequencies, 1 dampings"),
        ("table_6_15", "matrices.M_kg=[[1.0]]", r"^matrices: the matrices have the shapes \(1, 1\), \(2, 2\)"),
        ("table_6_15", "matrices.published_Hz=[14.0]", r"^matrices.published_Hz: has 1 modes; the matrices have 2"),
        ("two_mass", "synthetic.structure.coordinate=3", r"^synthetic.structure.coordinate: is 3; the structure has 2"),
    ],
)
def test_wrong_made_up_inputs_name_their_key(name, change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        solved(name, FEW if name == "two_mass" else 'title="t"', change)


def test_explain() -> None:
    problem = load("problems/vibration_two_mass.toml", [FEW]).problem
    text = vibration.explain(problem, Context())  # type: ignore[arg-type]
    assert "3000 samples every 4 ms, 1 inputs, 2 outputs, SYNTHETIC (seed 63, noise 1e-05 m)" in text
    assert "A_c = logm(A) / T_s" in text
    assert "det(M lambda + K) = 0" in vibration.explain(load("problems/vibration_table_6_15.toml").problem, Context())  # type: ignore[arg-type]


def test_a_mass_that_contradicts_the_force_is_said() -> None:
    def words(mass: float) -> list[str]:
        given = f"physical.mass=[{{coordinate=1, mass_kg={mass}}}]"
        return [w for w in solved("two_mass", FEW, given).values["words"] if w.startswith("the mass of")]

    assert words(30.0) == []
    assert len(words(60.0)) == 1 and "given as 60 kg; force and recording say" in words(60.0)[0]


def test_a_model_that_predicts_nothing_says_so() -> None:
    found = solved("two_mass", FEW, "synthetic.noise_m=0.3", "subspace.order=4", "physical.refine=false",
                   "physical.force_coordinates=[]")  # fmt: skip
    assert sum("held-out samples are predicted" in w for w in found.values["words"]) == 2


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name, noise", [("step", 2e-4), ("hammer", 1.5e-4)])
def test_errors_that_noise_explains_fail_no_check(name: str, noise: float, seed: int) -> None:
    modes = ["impulse.modes=2"] if name == "hammer" else []
    noisy = solved(name, f"synthetic.noise_m={noise}", f"synthetic.seed={seed + 1}", *modes)
    assert noisy.checks and all(check.passed for check in noisy.checks.values()), noisy.checks


@pytest.mark.parametrize("name", ["two_mass", "step", "hammer"])
def test_a_stop_is_heard_between_the_steps_of_a_fit(name) -> None:
    """Asked once before the fit and at every order, delay, number of resonances and iteration of it."""
    changes = [FEW] if name == "two_mass" else []
    problem = load(f"problems/vibration_{name}.toml", changes).problem
    for after in (1, 2, 4):
        context, asked = Context(), []

        def interrupted(asked=asked, after=after) -> bool:
            asked.append(None)
            return len(asked) > after

        context.interrupted = interrupted  # type: ignore[method-assign]
        outcome = vibration.solve(problem, context)  # type: ignore[arg-type]
        assert outcome.status is SolveStatus.INTERRUPTED and len(asked) == after + 1
        assert not outcome.values and not outcome.files
