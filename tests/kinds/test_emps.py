"""The EMPS drive as it was measured: against published numbers, with honest intervals, and in its own loops.

Janot, Gautier, Brunot, Data set and reference models of EMPS, Nonlinear System Identification Benchmarks, 2019.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.identify import Processing, Regressor, rows_of
from gtmodel.kinds import identification
from gtmodel.measurements import Column, Corrections, Signal, read_signals
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load, validate
from gtmodel.problem_files.python_models import resolve
from gtmodel.results import SolveStatus

PROBLEMS = Path(__file__).parents[2] / "problems"
DATA = PROBLEMS / "../../shared/realdata/emps/DATA_EMPS.mat"
PUBLISHED = {"M": 95.1089, "F_v": 203.5034, "F_c": 20.3935, "offset": -3.1648}
FREE = list(PUBLISHED)

measured = pytest.mark.skipif(not DATA.is_file(), reason="the EMPS recording is not beside the clone (shared/realdata)")


@pytest.fixture(scope="module")
def solved():
    settings = ["closed_loop.every=8", "closed_loop.tolerance=1e-6"]  # nearly the same, in a third of the time
    loaded = load(PROBLEMS / "emps.toml", settings)
    context = Context(folder=PROBLEMS)
    return identification.solve(loaded.problem, context), context  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def rows():
    signals = {"q": Signal("qm", "m"), "tau": Signal("vir", "V", scale=35.15065188248547, quantity_unit="N")}
    raw = read_signals([DATA], signals, time=Column("t", "s"))
    model = resolve("models/emps.py:Emps", Context(folder=PROBLEMS), "robot")
    return rows_of(Corrections(signals, raw).apply(), Regressor(model, FREE), Processing(40.0, every=1))


@measured
def test_published_numbers_come_back(solved) -> None:
    outcome, context = solved
    found = outcome.values["parameters"]
    assert outcome.status is SolveStatus.SOLVED and list(outcome.values) == list(identification.VALUES)
    for name in ("M", "F_v", "F_c"):
        assert found[name] == pytest.approx(PUBLISHED[name], rel=0.015), name
        assert abs(outcome.values["published"][name]) < 0.015
    assert found["offset"] == pytest.approx(PUBLISHED["offset"], abs=0.1)
    assert outcome.values["residual_share"][0] < 0.05
    assert context.inputs["log.files[0]"].name == "DATA_EMPS.mat"


@measured
def test_the_numbers_hardly_depend_on_the_cutoff() -> None:
    data = load(PROBLEMS / "emps.toml").problem.model_dump(exclude_none=True)
    bare = {k: v for k, v in data.items() if k not in ("filter", "closed_loop")}
    for cutoff in ({}, {"cutoff_Hz": 10.0}, {"cutoff_Hz": 80.0}):
        problem = validate(identification.Schema, {**bare, "filter": cutoff})
        found = identification.solve(problem, Context(folder=PROBLEMS)).values
        assert cutoff or 15.0 < found["cutoff_Hz"] < 25.0
        # the friction at the reversals, which a narrow filter spreads, is not quite Coulomb's: half a per cent
        assert all(found["parameters"][n] == pytest.approx(PUBLISHED[n], rel=0.006) for n in ("M", "F_v", "F_c"))
        assert found["parameters"]["offset"] == pytest.approx(PUBLISHED["offset"], abs=0.05)


@measured
def test_intervals_are_as_wide_as_the_scatter_of_parts_of_the_recording(solved, rows) -> None:
    values = solved[0].values
    assert values["confidence"] == "newey_west"
    J, tau = rows.Y[:, 0, :], rows.effort[:, 0]
    white = np.sqrt(np.diag(np.linalg.inv(J.T @ J)) * np.mean((tau - J @ np.linalg.lstsq(J, tau)[0]) ** 2))
    # six parts that are no whole periods of the motion: their mean scatters by their spread over the root of six
    parts = np.array([np.linalg.lstsq(J[k], tau[k])[0] for k in np.array_split(np.arange(len(tau)), 6)])
    scatter = parts.std(axis=0, ddof=1) / np.sqrt(6)
    half = np.array([np.subtract(*values["intervals"][n][::-1]) / 2 for n in FREE])
    # a spread of six draws is known within a factor of two or so; white intervals are five times too narrow and more
    assert np.all(half / 1.96 > scatter / 2), (half / 1.96, scatter)
    assert np.all(white < scatter / 3), (white, scatter)
    low, high = np.array([values["intervals"][n] for n in FREE]).T
    assert np.all((low < list(PUBLISHED.values())) & (list(PUBLISHED.values()) < high))


@measured
def test_the_closed_loop_follows_the_measured_position(solved) -> None:
    outcome, _ = solved
    v = outcome.values
    # the motion is 0.25 m long and the loop itself lags by 0.6 mm rms
    assert v["closed_loop_rms"][0] < 5e-6 and v["closed_loop_maximum"][0] < 2e-5
    assert v["closed_loop_relative"][0] < 1e-4 and v["closed_loop_effort"][0] < 0.08
    titles = [axes.get_title() for axes in outcome.figures["closed_loop"]().axes]
    assert f"simulated - measured, {1e6 * v['closed_loop_rms'][0]:.3g} µm rms" in titles
    assert outcome.figures["efforts"]().axes


@measured
def test_an_offset_in_the_line_of_the_signal_is_that_of_the_model() -> None:
    settings = ['free=["M", "F_v", "F_c"]', "log.effort.offset=estimate", "parameters.offset=0.0", "published={}"]
    data = load(PROBLEMS / "emps.toml", settings).problem.model_copy(update={"closed_loop": None})
    found = identification.solve(data, Context(folder=PROBLEMS)).values  # type: ignore[arg-type]
    assert found["corrections"]["tau.offset"] == pytest.approx(PUBLISHED["offset"], abs=0.1)
    low, high = found["intervals"]["tau.offset"]
    assert low < PUBLISHED["offset"] < high
    assert found["parameters"]["M"] == pytest.approx(PUBLISHED["M"], rel=0.015)


BARE: dict[str, Any] = {
    "kind": "identification",
    "robot": "models/emps.py:Emps",
    "free": FREE,
    "log": {
        "files": ["nowhere.mat"],
        "position": {"column": "qm", "unit": "m"},
        "effort": {"column": "vir", "unit": "V", "scale": 35.0},
    },
}
LOOP = {"model": "models/emps.py:ControlledEmps", "inputs": {"qg": {"column": "qg", "unit": "m"}}}


@pytest.mark.parametrize(
    ("changes", "key", "said"),
    [
        ({}, "log.files[0]", "there is no file 'nowhere.mat'"),
        ({"published": {"mass": 95.0}}, "published.mass", "has no parameter 'mass'"),
        ({"closed_loop": LOOP, "log": None, "synthetic": {"reference": "q"}}, "closed_loop", r"give a \[log\]"),
        ({"closed_loop": {**LOOP, "inputs": {"gq": LOOP["inputs"]["qg"]}}}, "closed_loop.inputs.gq", "gq"),
    ],
)  # fmt: skip
def test_refusals_name_the_key(changes: dict[str, Any], key: str, said: str) -> None:
    data = {k: v for k, v in {**BARE, **changes}.items() if v is not None}
    with pytest.raises(InputError, match=said) as caught:
        identification.solve(validate(identification.Schema, data), Context(folder=PROBLEMS))
    assert caught.value.key == key
