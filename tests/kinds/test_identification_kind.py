"""Kind "identification": the shipped problem, logs by their keys, and where refusals stand in the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import multisine
from gtmodel.kinds.identification import kind
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import Loaded, load, validate
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus
from tests.identify.plants import BAND, NOISE, SAMPLE_TIME, plant, simulator
from tests.support import recordings
from tests.support.refusals import key_of_refusal

PROBLEMS = Path(__file__).parents[2] / "problems"
SHORT: dict[str, Any] = {"duration_s": 12.0, "parameters": {"m_a": [0.5, 1.0, 1.5]}}


def loaded(**changes: object) -> Loaded:
    data = {"kind": "identification", "robot": "l1_tape", "variant": "links", "synthetic": SHORT, **changes}
    problem = validate(kind.Schema, {k: v for k, v in data.items() if v is not None})
    return Loaded(Path("identification.toml"), b"", (), kind, problem, False)  # type: ignore[arg-type]


def solved(context: Context | None = None, **changes: object) -> Any:
    return answer(loaded(**changes), context or Context())


def refused(context: Context | None = None, **changes: object) -> str:
    """The key at which the changed problem is refused."""
    return key_of_refusal(lambda: solved(context, **changes))


def test_the_shipped_problem() -> None:
    found: Any = answer(load("problems/inertia_l1.toml", ["synthetic.duration_s=16"]), Context())
    assert found.status is SolveStatus.SOLVED and len(found.parameters) == 13 and found.rows
    assert found.title == "Masses and friction of the L1 prototype"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """log.csv in millimetres and kilonewtons, as a stranger's logger might write it, forces 8 N off on every cart; and
    trajectory.csv as an excitation writes it, with other columns."""
    t = simulator(16.0).truth
    tau = t["tau"] + 8.0 + NOISE * np.random.default_rng(6).normal(size=t["tau"].shape)
    folder = tmp_path_factory.mktemp("logs")
    table = np.column_stack([t.time, 1e3 * np.round(t["q"], 6), 1e-3 * tau])
    header = "t [s],x1 [mm],x2 [mm],x3 [mm],F[0],F[1],F[2]"
    lines = ["# synthetic: seed 6, 30 N white", header, *(",".join(f"{v:.9g}" for v in row) for row in table)]
    (folder / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    time = SAMPLE_TIME * np.arange(round(8.0 / SAMPLE_TIME) + 1)
    T = multisine(time, np.asarray(plant().home, dtype=float), np.full(3, 0.3), np.array(BAND), seed=9)
    signals = {"T": T, "tau": np.zeros((len(time), 3))}
    gt.Trajectory(time, signals, {"T": "m", "tau": "N"}, title="closed").to_csv(folder / "trajectory.csv")
    return folder


LOG: dict[str, Any] = {
    "files": ["log.csv"],
    "held_out": ["log.csv"],
    "time": {"column": "t"},
    "position": {"column": ["x1", "x2", "x3"], "unit": "mm"},
    "effort": {"column": "F", "unit": "kN", "offset": "estimate", "per_session": []},
    "sample_time_s": SAMPLE_TIME,
}


def test_a_log_with_units_and_an_offset_of_its_own(folder: Path) -> None:
    found = solved(Context(folder=folder), synthetic=None, log=LOG)
    assert found.status is SolveStatus.SOLVED and found.synthetic == "seed 6, 30 N white"
    assert sorted(found.corrections) == [f"tau.offset[{i}]" for i in range(3)]
    assert found.parameters["m_p"] == pytest.approx(9.13, abs=0.6)
    assert found.held_out_rms == pytest.approx(found.noise, rel=0.1)  # the same log


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"files": ["no.csv"]}, "log.files[0]"),
        ({"files": []}, "log.files"),
        ({"position": {"column": "x4", "unit": "mm"}}, "log"),
        ({"position": {"column": "x1", "unit": "mm"}}, "log.position.column"),
        ({"position": {"column": ["x1", "x2", "x3"], "unit": "m"}}, "log"),
        ({"effort": {"column": "F", "unit": "V"}}, "log.effort"),
        ({"effort": {"column": "F[0]", "unit": "kN"}}, "log.effort.column"),
        ({"effort": {"column": "F", "unit": "kN", "scale": "estimate"}}, "log"),
        ({"effort": {"column": "F", "unit": "kN", "offset": "estimate"}, "files": ["log.csv"] * 2}, "log.held_out"),
        ({"sample_time_s": 0.002}, "log"),
    ],
)
def test_wrong_logs(folder: Path, changes: dict[str, object], key: str) -> None:
    assert refused(Context(folder=folder), synthetic=None, log={**LOG, **changes}) == key


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"synthetic": None}, "log"),
        ({"variant": "model_5"}, "variant"),
        ({"variant": None}, "free"),
        ({"variant": None, "free": ["m_q"]}, "free"),
        ({"watch": ["m_p"]}, "watch"),
        ({"robot": "d1_six_link"}, "variant"),
        ({"inertia": "model_1"}, "inertia"),
        ({"friction": {"smoothing": "piecewise_linear"}}, "friction.smoothing"),
        ({"known": "p"}, "known"),
        ({"nonnegative": ["m_q"]}, "nonnegative"),
        ({"published": {"mass": 1.0}}, "published.mass"),
        ({"synthetic": {"duration_s": 1.0}}, "synthetic.ramp_s"),
        ({"synthetic": {"half_range": 3.0}}, "synthetic.half_range"),
        ({"synthetic": {"duration_s": 3.0, "sample_time_s": 0.002}}, "synthetic"),
    ],
)
def test_wrong_problems(changes: dict[str, object], key: str) -> None:
    assert refused(**changes) == key


def test_a_motion_of_a_file(folder: Path) -> None:
    context, way = Context(folder=folder), {**SHORT, "reference_file": "trajectory.csv", "repeats": 2}
    found = solved(context, synthetic=way)
    assert context.inputs["synthetic.reference_file"].name == "trajectory.csv"
    assert 14.0 < found.trajectory.time[-1] < 16.0  # twice its 8 s, cut by the filter
    for wrong in ({"reference_file": "no.csv"}, {"reference": "q"}):
        assert refused(context, synthetic={**way, **wrong}) == "synthetic.reference_file"


LOOP = {"model": "models/emps.py:ControlledEmps", "inputs": {"qg": {"column": "qg", "unit": "m"}}}
EMPS = {
    "robot": "models/emps.py:Emps", "variant": None, "synthetic": None, "free": ["M", "F_v", "F_c", "offset"],
    "log": {
        "files": ["nowhere.mat"], "position": {"column": "qm", "unit": "m"},
        "effort": {"column": "vir", "unit": "V", "scale": 35.0},
    },
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({}, "log.files[0]"),
        ({"closed_loop": LOOP, "log": None, "synthetic": {"reference": "q"}}, "closed_loop"),
        ({"closed_loop": {**LOOP, "inputs": {"gq": LOOP["inputs"]["qg"]}}}, "closed_loop.inputs.gq"),  # type: ignore[index]
        ({"closed_loop": {**LOOP, "inputs": {"qg": {"column": "qg", "unit": "V"}}}}, "closed_loop.inputs.qg"),
        (
            {"closed_loop": {**LOOP, "inputs": {"qg": {"column": "qg", "unit": "m", "scale": "estimate"}}}},
            "closed_loop.inputs.qg.scale",
        ),
        ({"closed_loop": {**LOOP, "model": "models/emps.py:Emsp"}}, "closed_loop.model"),
    ],
)
def test_a_model_in_python_and_its_loop(changes: dict[str, Any], key: str) -> None:
    assert refused(Context(folder=PROBLEMS), **{**EMPS, **changes}) == key


@pytest.mark.skipif(not recordings.EMPS.is_file(), reason=recordings.NO_EMPS)
def test_the_drive_as_measured() -> None:
    context = Context(folder=PROBLEMS)
    quick = ["closed_loop.every=20", "closed_loop.tolerance=1e-5", f"log.files=['{recordings.EMPS}']"]
    found: Any = answer(load(PROBLEMS / "emps.toml", quick), context)
    assert found.status is SolveStatus.SOLVED and len(found.closed_loop_rms) == 1 and len(found.published) == 4
    assert context.inputs["log.files[0]"].name == "DATA_EMPS.mat"


def test_explain() -> None:
    text = explain(loaded(), Context())
    assert "m_a[2] [kg], free" in text and "from q, der(q), der(q,2)" in text
