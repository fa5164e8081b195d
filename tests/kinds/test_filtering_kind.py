"""The kind "filtering": a person's own model, sensors, noise and log from a file, against filters made by hand."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError
from tests.support import belt_drive
from tests.support.commands import CLONE, Commands

F = gt.filtering
SHIPPED = CLONE / "problems" / "filter_pendulum.toml"
CART = """
import gtmodel as gt
class Cart(gt.Model):
    x, v = gt.variable(unit="m"), gt.variable(unit="m/s")
    a, force = gt.input(unit="m/s2"), gt.input(unit="m/s2")
    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.a + self.force
"""
PROBLEM = """
kind = "filtering"
model = "cart.py:Cart"
states = ["x", "v"]
filter = "kf"
noise = {a = 0.5}
sensors = {tape = {signal = "x", deviation = 0.02}}
start = {mean = {x = 0.3}, deviation = {x = 0.5, v = 1.0}}
[log]
files = ["log.csv"]
readings = {tape = {column = "tape", unit = "mm"}}
inputs = {force = {column = "force", unit = "m/s2"}}
"""
STEP, ROWS = 0.05, 200


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(5)  # synthetic: seed 5
    time = STEP * np.arange(ROWS)
    force = np.sin(time)
    x = 0.4 - np.sin(time) + 0.1 * np.cumsum(rng.standard_normal(ROWS)) * STEP
    rows = np.column_stack([time, 1e3 * (x + 0.02 * rng.standard_normal(ROWS)), force])
    (tmp_path / "cart.py").write_text(CART)
    (tmp_path / "p.toml").write_text(PROBLEM)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time,tape,force", comments="", fmt="%.17g")
    return tmp_path


def by_hand(log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kalman's equations for a cart under white acceleration and a force that runs straight between rows."""
    A = np.array([[1.0, STEP], [0.0, 1.0]])
    Q = 0.5 * np.array([[STEP**3 / 3, STEP**2 / 2], [STEP**2 / 2, STEP]])
    x, P, means, deviations = np.array([0.3, 0.0]), np.diag([0.25, 1.0]), [], []
    for k, (_, tape, force) in enumerate(log):
        if k:
            before = log[k - 1, 2]
            x = A @ x + [STEP**2 * (2 * before + force) / 6, STEP * (before + force) / 2]
            P = A @ P @ A.T + Q
        K = P[:, 0] / (P[0, 0] + 0.02**2)
        x, P = x + K * (tape / 1e3 - x[0]), P - np.outer(K, P[0])
        means.append(x)
        deviations.append(np.sqrt(np.diag(P)))
    return np.array(means), np.array(deviations)


def test_a_persons_own_model_and_log_are_filtered_as_by_hand(folder: Path, gtmodel: Commands) -> None:
    done = gtmodel("solve", folder / "p.toml", "--json", "--plot", "--out", folder / "out")
    assert done.code == 0, done.err
    means, deviations = by_hand(np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1))
    made = gt.load(folder / "p.toml")().trajectory
    for k, name in enumerate(("x", "v")):
        assert made[name] == pytest.approx(means[:, k], rel=1e-9, abs=1e-9)
        assert made[f"{name}.deviation"] == pytest.approx(deviations[:, k], rel=1e-9)
    assert done.json["values"]["readings"] == {"tape": ROWS} and not made.synthetic
    assert {p.name for p in (folder / "out").glob("*.png")} == {"estimates.png", "innovations.png"}


@cache
def shipped() -> F.FilterStudy:
    return gt.load(SHIPPED)()


def test_the_model_of_the_shipped_problem_has_twelve_lines_and_its_errors_are_what_the_filter_says() -> None:
    lines = (CLONE / "problems" / "models" / "pendulum.py").read_text()
    assert len(lines.splitlines()) <= 12
    study = shipped()
    assert study.status.ok and study.synthetic and study.trajectory.synthetic
    low, high = study.nis_band
    assert low < study.nis < high
    for name, (error,) in study.rms_error.items():
        # 20 s hold some tens of independent errors
        assert error == pytest.approx(study.rms_deviation[name][0], rel=0.25)
        assert study.smoothed_rms_error[name][0] < error
    assert set(study.figures) == {"estimates", "errors", "innovations"}


def test_the_file_is_the_call_of_the_library() -> None:
    call = gt.load(SHIPPED)
    system, start, asked, name = call.arguments
    own = F.filter_study(system, start, asked, name, smoothing=True)
    assert own.trajectory["angle"].tolist() == shipped().trajectory["angle"].tolist()


def test_wrong_noise_is_said_with_its_name() -> None:
    parts = [F.StatePart("x", unit="m")]
    process = F.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    right = F.System(process, [F.Sensor("tape", "x", deviation=0.01)])
    start = F.FilterStart(deviation={"x": 1.0})
    drawn = F.draw(right, F.InitialState({}, {"x": 1.0}), 0.1 * np.arange(1000), seed=3)
    study = F.filter_study(right.with_(deviations={"tape": 0.1}), start, drawn.log)
    assert study.status.ok and study.nis < study.nis_band[0] and "tape" in study.verdict
    # 1,000 instants: the band is that of chi-squared over its degrees of freedom
    assert study.nis_band == pytest.approx(scipy.stats.chi2.ppf([0.0005, 0.9995], 1000) / 1000, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("a = 0.5", "b = 0.5", "Cart has no variable 'b'"),
        ('signal = "x"', 'signal = "y"', "Cart has no variable 'y'"),
        ("deviation = 0.02", "gate = 0.99", "sensors.tape.deviation"),
        ("{x = 0.5, v = 1.0}", "{x = 0.5}", "start.deviation"),
        ("{x = 0.5, v = 1.0}", "{x = 0.5, w = 1.0}", "start.deviation"),
        ('filter = "kf"', 'filter = "wiener"', "filter"),
        ('inputs = {force = {column = "force", unit = "m/s2"}}', "", "Cart: 2 equations for 3 unknowns"),
        ('files = ["log.csv"]', "files = []", "log.files"),
        ('column = "tape"', 'column = "tap"', "log"),
        ("[log]", "[synthetic]\nduration_s = 1.0\n[log]", "log"),
        ("cart.py:Cart", "cart.py:Card", "model"),
    ],
)
def test_what_is_wrong_is_refused_at_its_key(folder: Path, gtmodel: Commands, old: str, new: str, key: str) -> None:
    text = (folder / "p.toml").read_text()
    assert old in text
    (folder / "p.toml").write_text(text.replace(old, new))
    done = gtmodel("solve", folder / "p.toml", "--out", folder / "out")
    assert done.code == 2 and f"p.toml: {key}" in done.err, done.err


def test_a_start_that_names_no_state_is_refused_where_it_stands() -> None:
    parts = [F.StatePart("x", unit="m")]
    system = F.System(F.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4]), [F.Sensor("x", deviation=0.01)])
    with pytest.raises(ArgumentError) as refused:
        F.filter_study(system, F.FilterStart(deviation={"y": 1.0}), F.DrawnReadings(duration=1.0, step=0.1))
    assert refused.value.argument == "start.deviation"


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ('filter="particle"', "smoothing"), ('filter="kf"', "filter"),
        ("synthetic.duration_s=0.001", "synthetic.duration_s"),
        ("sensors.angle.period_s=0.033", "synthetic.step_s"), ('sensors.gyro.kind="quaternion"', "sensors"),
        ("noise.push=-1.0", "noise.push"), ("start.deviation.rate=-1.0", "start.deviation.rate"),
    ],
)  # fmt: skip
def test_what_cannot_be_filtered_names_its_key(gtmodel: Commands, tmp_path: Path, setting: str, key: str) -> None:
    done = gtmodel("solve", SHIPPED, "--out", tmp_path / "out", "--set", setting)
    assert done.code == 2 and f"filter_pendulum.toml: {key}: " in done.err, done.err


@pytest.mark.parametrize("name", ["iekf", "ukf"])
def test_other_filters_of_nearly_linear_motion_say_the_same(name: str) -> None:
    study, usual = gt.load(SHIPPED, f'filter="{name}"', "smoothing=false")(), shipped()
    assert study.trajectory["angle"] == pytest.approx(usual.trajectory["angle"], abs=1e-3)  # a third of its deviation
    assert study.smoothed_rms_error == {} and set(study.rms_error) == {"angle", "rate"}


BELT = CLONE / "problems" / "filter_belt_drive.toml"


def test_the_shipped_belt_drive_is_estimated_and_started_from_its_rest(gtmodel: Commands, tmp_path: Path) -> None:
    done = gtmodel("solve", BELT, "--json", "--out", tmp_path / "out")
    assert done.code == 0, done.err
    values = done.json["values"]
    for name, truth in belt_drive.TRUTH.items():
        assert values["noise_low"][name][0] < truth < values["noise_high"][name][0]
    assert values["noise_source"] == {
        "encoder.deviation": "rest", "scale.deviation": "rest", "push.density": "likelihood"
    }  # fmt: skip
    # what was used for the start is not filtered again
    count = np.count_nonzero(belt_drive.torque().time > 0.39)
    assert values["readings"]["encoder"] == count
    assert values["nis_band"][0] < values["nis"] < values["nis_band"][1]
    assert "none of the suspects" in values["faults"] and min(values["fault_p"].values()) > 1e-4
    rows = np.genfromtxt(tmp_path / "out" / "innovations.csv", delimiter=",", names=True, deletechars="")
    assert len(rows) == count and rows["count"].sum() == 2 * count
    assert rows["nis"].mean() == pytest.approx(values["nis"], rel=1e-9)
    white = rows["encoder.innovation"] / rows["encoder.deviation"]
    assert white.std() == pytest.approx(1.0, abs=0.15)


def test_an_offset_in_the_log_is_named(gtmodel: Commands, tmp_path: Path) -> None:
    """The same log with the scale 0.5 degrees off, from a start with wide deviations: that at rest holds the offset."""
    table = np.loadtxt(belt_drive.FILE, delimiter=",", skiprows=2)
    table[:, 3] += 0.5
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,torque,encoder,scale", comments="")
    done = gtmodel(
        "solve", BELT, "--json", "--out", tmp_path / "out", "--set", f'log.files=["{tmp_path / "log.csv"}"]',
        "--set", 'faults={"scale.offset" = 0.02, "encoder.deviation" = 1.0}', "--set", "noise.push=1e-3",
        "--set", "start={deviation={motor=0.5, load=0.5, motor_rate=1.0, load_rate=1.0}}",
    )  # fmt: skip
    values = done.json["values"]
    assert "scale.offset explains the log best" in values["faults"]
    assert abs(values["fault_sizes"]["scale.offset"][0]) == pytest.approx(np.radians(0.5), rel=0.2)
    assert "agree with the filter" not in values["verdict"]


def test_a_log_at_rest_in_a_file_of_its_own_gives_the_deviation(folder: Path, gtmodel: Commands) -> None:
    rng = np.random.default_rng(9)  # synthetic: seed 9
    rows = np.column_stack([STEP * np.arange(300), 400 + 20 * rng.standard_normal(300), np.zeros(300)])
    np.savetxt(folder / "rest.csv", rows, delimiter=",", header="time,tape,force", comments="", fmt="%.17g")
    text = (folder / "p.toml").read_text().replace("deviation = 0.02", 'deviation = "estimate"')
    (folder / "p.toml").write_text(text.replace("[log]", '[log]\nrest = "rest.csv"'))
    done = gtmodel("solve", folder / "p.toml", "--json", "--out", folder / "out")
    assert done.code == 0, done.err
    assert done.json["values"]["noise"]["tape.deviation"] == pytest.approx([np.std(rows[:, 1], ddof=1) / 1e3])
    assert {"rest.csv", "log.csv"} <= {p.name for p in folder.iterdir()}
    assert "rest.csv" in (folder / "out" / "run.toml").read_text()


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (['sensors.tape.deviation="estimate"', "log.rest_s=[0.0, 1.0]", 'log.rest="log.csv"'], "log.rest_s"),
        (['sensors.tape.deviation="estimate"', "log.rest_s=[1.0]"], "log.rest_s"),
        (['sensors.tape.deviation="estimate"', "log.rest_s=[100.0, 101.0]"], "log.rest_s"),
        (['sensors.tape.deviation="estimate"', 'log.rest="none.csv"'], "log.rest"),
        (["start.from_rest=true"], "start.from_rest"),
        (['noise.a="guess"'], "noise.a"),
        (["faults={tape.offset=0.0}"], "faults"),
        (['faults={"tap.offset"=0.1}'], "faults"),
    ],
)
def test_a_wrong_rest_or_estimate_names_its_key(folder: Path, gtmodel: Commands, settings: list[str], key: str) -> None:
    options = [word for setting in settings for word in ("--set", setting)]
    done = gtmodel("solve", folder / "p.toml", "--out", folder / "out", *options)
    assert done.code == 2 and f"p.toml: {key}" in done.err, done.err


@pytest.mark.parametrize("setting", ['noise.push="estimate"', 'sensors.angle.deviation="estimate"'])
def test_synthetic_readings_need_noise(gtmodel: Commands, tmp_path: Path, setting: str) -> None:
    done = gtmodel("solve", SHIPPED, "--out", tmp_path / "out", "--set", setting)
    assert done.code == 2 and f"filter_pendulum.toml: {setting.partition('=')[0]}: " in done.err, done.err
