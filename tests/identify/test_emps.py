"""The EMPS drive as it was measured: against published numbers, with honest intervals, and in its own loops.

Janot, Gautier, Brunot, Data set and reference models of EMPS, Nonlinear System Identification Benchmarks, 2019.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import ClosedLoop, Fitting, Processing, Regressor, rows_of, study
from gtmodel.measurements import ESTIMATE, Column, Corrections, Signal, read_signals
from gtmodel.mechanics import Mass
from gtmodel.problem_files import Context
from gtmodel.problem_files.python_models import resolve
from gtmodel.results import ArgumentError, SolveStatus
from tests.support.recordings import EMPS, EMPS_PULSES, NO_EMPS, elsewhere

PROBLEMS = Path(__file__).parents[2] / "problems"
PUBLISHED = {"M": 95.1089, "F_v": 203.5034, "F_c": 20.3935, "offset": -3.1648}
FREE = list(PUBLISHED)
SIGNALS = {
    "q": Signal("qm", "m"),
    "tau": Signal("vir", "V", scale=35.15065188248547, quantity_unit="N"),
    "qg": Signal("qg", "m"),
}
SHARP, NONNEGATIVE = Processing(40.0), Fitting(nonnegative=["M", "F_v", "F_c"])

measured = pytest.mark.skipif(not EMPS.is_file(), reason=NO_EMPS)


def model(name: str, **parameters: float) -> Any:
    return resolve(f"models/emps.py:{name}", Context(folder=PROBLEMS), "robot", parameters)


def identified(free: list[str] = FREE, signals: dict[str, Signal] = SIGNALS, **options: Any):
    raw = read_signals([EMPS], signals, time=Column("t", "s"), sample_time=0.001)
    robot = options.pop("robot", None) or model("Emps")
    return study(robot, raw, free, signals=signals, fitting=NONNEGATIVE, **options)


@pytest.fixture(scope="module")
def solved():
    # a coarser loop: nearly the same, in a third of the time
    loop = ClosedLoop(model("ControlledEmps"), ["qg"], every=8, tolerance=1e-6)
    return identified(processing=SHARP, published=PUBLISHED, closed_loop=loop)


@pytest.fixture(scope="module")
def rows():
    signals = {name: SIGNALS[name] for name in ("q", "tau")}
    raw = read_signals([EMPS], signals, time=Column("t", "s"))
    return rows_of(Corrections(signals, raw).apply(), Regressor(model("Emps"), FREE), Processing(40.0, every=1))


@measured
def test_published_numbers_come_back(solved) -> None:
    found = solved.parameters
    assert solved.status is SolveStatus.SOLVED
    for name in ("M", "F_v", "F_c"):
        assert found[name] == pytest.approx(PUBLISHED[name], rel=0.015), name
        assert abs(solved.published[name]) < 0.015
    assert found["offset"] == pytest.approx(PUBLISHED["offset"], abs=0.1)
    assert solved.residual_share[0] < 0.05
    assert sum(row.label.startswith("published") for row in solved.rows) == len(PUBLISHED)


@measured
def test_the_numbers_hardly_depend_on_the_cutoff() -> None:
    for cutoff in (None, 10.0, 80.0):
        found = identified(signals={n: SIGNALS[n] for n in ("q", "tau")}, processing=Processing(cutoff))
        assert cutoff or 15.0 < found.cutoff < 25.0
        # the friction at the reversals, which a narrow filter spreads, is not quite Coulomb's: half a per cent
        assert all(found.parameters[n] == pytest.approx(PUBLISHED[n], rel=0.006) for n in ("M", "F_v", "F_c"))
        assert found.parameters["offset"] == pytest.approx(PUBLISHED["offset"], abs=0.05)


@measured
def test_intervals_are_as_wide_as_the_scatter_of_parts_of_the_recording(solved, rows) -> None:
    assert solved.confidence == "newey_west"
    J, tau = rows.Y[:, 0, :], rows.effort[:, 0]
    white = np.sqrt(np.diag(np.linalg.inv(J.T @ J)) * np.mean((tau - J @ np.linalg.lstsq(J, tau)[0]) ** 2))
    # six parts that are no whole periods of the motion: their mean scatters by their spread over the root of six
    parts = np.array([np.linalg.lstsq(J[k], tau[k])[0] for k in np.array_split(np.arange(len(tau)), 6)])
    scatter = parts.std(axis=0, ddof=1) / np.sqrt(6)
    half = np.array([np.subtract(*solved.intervals[n][::-1]) / 2 for n in FREE])
    # a spread of six draws is known within a factor of two or so; white intervals are five times too narrow and more
    assert np.all(half / 1.96 > scatter / 2), (half / 1.96, scatter)
    assert np.all(white < scatter / 3), (white, scatter)
    low, high = np.array([solved.intervals[n] for n in FREE]).T
    assert np.all((low < list(PUBLISHED.values())) & (list(PUBLISHED.values()) < high))


@measured
def test_the_closed_loop_follows_the_measured_position(solved) -> None:
    # the motion is 0.25 m long and the loop itself lags by 0.6 mm rms
    assert solved.closed_loop_rms[0] < 5e-6 and solved.closed_loop_maximum[0] < 2e-5
    assert solved.closed_loop_relative[0] < 1e-4 and solved.closed_loop_effort[0] < 0.08
    titles = [axes.get_title() for axes in solved.figure("closed_loop").axes]
    assert f"simulated - measured, {1e6 * solved.closed_loop_rms[0]:.3g} µm rms" in titles
    assert solved.figure("efforts").axes


@measured
def test_an_offset_in_the_line_of_the_signal_is_that_of_the_model() -> None:
    effort = Signal("vir", "V", scale=35.15065188248547, offset=ESTIMATE, quantity_unit="N")
    found = identified(FREE[:3], {"q": SIGNALS["q"], "tau": effort}, robot=model("Emps", offset=0.0), processing=SHARP)
    assert found.corrections["tau.offset"] == pytest.approx(PUBLISHED["offset"], abs=0.1)
    low, high = found.intervals["tau.offset"]
    assert low < PUBLISHED["offset"] < high
    assert found.parameters["M"] == pytest.approx(PUBLISHED["M"], rel=0.015)


@measured
@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"published": {"mass": 95.0}}, "published.mass"),
        ({"closed_loop": ClosedLoop(model("ControlledEmps"), ["gq"])}, "closed_loop.inputs"),
        ({"closed_loop": ClosedLoop(model("Emps"), [])}, "closed_loop"),
        ({"closed_loop": ClosedLoop(model("ControlledEmps"), [])}, "closed_loop"),
        ({"closed_loop": ClosedLoop(Mass(), [])}, "closed_loop.model"),
    ],
)
def test_refusals_name_the_argument(options: dict[str, Any], argument: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        identified(processing=SHARP, **options)
    assert caught.value.argument == argument


def test_the_recording_with_pulses_judges_it(tmp_path: Path) -> None:
    """Synthetic stand-ins where the recordings are absent: the same problem, its held-out error near the noise."""
    problem = gt.load(PROBLEMS / "emps_pulses.toml", *elsewhere("emps_pulses", tmp_path))
    found = problem()
    assert found.status.ok and all(check.passed for check in found.checks.values()), found.checks
    assert found.held_out_rms[0] < 1.4 * found.noise[0]
    assert max(abs(x) for x in found.published.values()) < 0.1
    assert "held_out" in found.figures


@pytest.mark.skipif(not (EMPS.is_file() and EMPS_PULSES.is_file()), reason="the EMPS recordings are not both there")
def test_the_voltage_contains_the_pulses() -> None:
    """The residuals of the held-out recording on the pulses: 0, and not 1 N per N."""
    signals = {name: SIGNALS[name] for name in ("q", "tau")} | {"push": Signal("pulses_N", "N")}
    raw = read_signals([EMPS_PULSES], signals, time=Column("t", "s"), sample_time=0.001)

    class Pushed(type(model("Emps"))):
        gain = gt.parameter(1.0, unit="1")
        push = gt.input(unit="N")

        def equations(self):
            rate = gt.der(self.q)
            friction = self.F_v * rate + self.F_c * gt.sign(rate) + self.offset
            yield self.tau + self.gain * self.push == self.M * gt.der(rate) + friction

    how = Fitting(inputs=["push"], nonnegative=False)
    found = study(Pushed(), raw, [*FREE, "gain"], signals=signals, fitting=how, processing=SHARP)
    assert abs(found.parameters["gain"]) < 0.3
