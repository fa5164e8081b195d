"""More than one measured input: an EMPS-like drive with 5 N pulses as a second measured force, a payload, a rate.

Synthetic: numbers of the EMPS drive, seeds and noise as stated.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import Context, InputError, explaining
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer

TRUE = {"M": 95.1089, "F_v": 203.5034, "F_c": 20.3935}
STEP, SEED, NOISE = 1e-3, 7, 0.5  # s, N


class Pushed(gt.Model):
    """A carriage on which a second, measured force pushes."""

    M = gt.parameter(90.0, unit="kg")
    F_v = gt.parameter(200.0, unit="kg/s")
    F_c = gt.parameter(20.0, unit="N")
    gain = gt.parameter(1.0, unit="1", description="of the sensor of the second force")
    q = gt.variable(unit="m")
    push = gt.input(unit="N")
    tau = gt.input(unit="N")

    def equations(self):
        v = gt.der(self.q)
        friction = self.F_v * v + self.F_c * gt.sign(v)
        yield self.tau + self.gain * self.push == self.M * gt.der(v) + friction


class Loaded(gt.Model):
    """A carriage with a payload that changes on the way, measured, and a force by its rate."""

    M, c = gt.parameter(5.0, unit="kg"), gt.parameter(1.0, unit="m/s")
    q, payload, tau = gt.variable(unit="m"), gt.input(unit="kg"), gt.input(unit="N")

    def equations(self):
        v = gt.der(self.q)
        yield self.tau == (self.M + self.payload) * gt.der(v) + self.c * gt.der(self.payload)


@pytest.fixture(scope="module")
def log() -> gt.Trajectory:
    """8 s at 1 kHz, 5 N pulses of 0.3 s every 0.8 s, noise of 0.5 N on the drive's force."""
    t = np.arange(8001) * STEP
    rates = 2 * np.pi * np.array([0.5, 1.25])
    q = 0.05 * np.sin(np.outer(t, rates)).sum(axis=1)
    v = 0.05 * (rates * np.cos(np.outer(t, rates))).sum(axis=1)
    a = -0.05 * (rates**2 * np.sin(np.outer(t, rates))).sum(axis=1)
    push = 5.0 * ((t % 0.8) > 0.5)
    force = TRUE["M"] * a + TRUE["F_v"] * v + TRUE["F_c"] * np.sign(v) - push
    force += NOISE * np.random.default_rng(SEED).standard_normal(len(t))
    signals = {"q": q, "tau": force, "push": push}
    return gt.Trajectory(t, signals, {"q": "m", "tau": "N", "push": "N"}, synthetic=f"seed {SEED}")


PROCESSING = gt.identify.Processing(cutoff=30.0)
WITH = gt.identify.Fitting(inputs=["push"])


@pytest.fixture(scope="module")
def study(log: gt.Trajectory):
    return gt.identify.study(Pushed(), log, [*TRUE, "gain"], fitting=WITH, processing=PROCESSING)


def test_a_second_force_is_taken_into_account(study) -> None:
    assert study.status.ok and all(c.passed for c in study.checks.values()), study.checks
    e = study.estimate
    for name, true in (TRUE | {"gain": 1.0}).items():
        assert abs(e.value(name) - true) < 4 * e.std[e.names.index(name)], name
    assert study.parameters["gain"] == pytest.approx(1.0, abs=0.02)


def test_without_it_the_noise_is_that_of_the_pulses(study, log: gt.Trajectory) -> None:
    still = gt.Trajectory(log.time, {"q": log["q"], "tau": log["tau"], "push": 0.0 * log["push"]}, log.units)
    blind = gt.identify.study(Pushed(), still, list(TRUE), fitting=WITH, processing=PROCESSING)
    assert blind.noise[0] > 10 * study.noise[0]


def test_rows_are_those_of_the_force_added_by_hand(log: gt.Trajectory) -> None:
    """The filters are linear: the force may as well be added before."""
    rows = gt.identify.rows_of(
        gt.measurements.session_of(log), gt.identify.Regressor(Pushed(), list(TRUE), known=["q", "push"]), PROCESSING
    )
    added = gt.Trajectory(
        log.time, {"q": log["q"], "tau": log["tau"] + log["push"], "push": 0 * log["push"]}, log.units
    )
    by_hand = gt.identify.rows_of(
        gt.measurements.session_of(added), gt.identify.Regressor(Pushed(), list(TRUE), known=["q", "push"]), PROCESSING
    )
    np.testing.assert_allclose(rows.effort - rows.y0, by_hand.effort - by_hand.y0, atol=1e-9)
    np.testing.assert_allclose(rows.Y, by_hand.Y, atol=1e-12)


def test_scale_and_delay_of_an_input_are_estimated_like_those_of_any_signal(log: gt.Trajectory) -> None:
    """Its column shows the force divided by 1.3, and 6 ms late."""
    late = np.interp(log.time - 0.006, log.time, log["push"]) / 1.3
    signals = {"q": log["q"], "tau": log["tau"], "push": late}
    raw = gt.Trajectory(log.time, signals, {"q": "m", "tau": "N", "push": "N"})
    Signal = gt.measurements.Signal
    read = {"q": Signal("q", "m"), "tau": Signal("tau", "N")}
    read["push"] = Signal("push", "N", scale="estimate", delay="estimate")
    s = gt.identify.study(Pushed(), raw, list(TRUE), fitting=WITH, processing=PROCESSING, signals=read)
    assert s.corrections["push.scale"] == pytest.approx(1.3, rel=0.01)
    assert s.corrections["push.delay"] == pytest.approx(0.006, abs=5e-4)
    assert next(row.unit for row in s.rows if row.label == "push.delay") == "s"


def test_values_and_rates_of_an_input_count() -> None:
    t = np.arange(4001) * 2e-3
    w, p = 2 * np.pi * 0.9, 2 * np.pi * 0.23
    payload = 3.0 + 2.0 * np.sin(p * t)
    a = -0.1 * w**2 * np.sin(w * t)
    tau = (4.0 + payload) * a + 0.7 * 2.0 * p * np.cos(p * t)
    tau = tau + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    log = gt.Trajectory(t, {"q": 0.1 * np.sin(w * t), "tau": tau, "payload": payload},
                        {"q": "m", "tau": "N", "payload": "kg"})  # fmt: skip
    fitting = gt.identify.Fitting(inputs=["payload"], nonnegative=False)
    s = gt.identify.study(Loaded(), log, ["M", "c"], fitting=fitting, processing=gt.identify.Processing(cutoff=8.0))
    assert s.parameters == pytest.approx({"M": 4.0, "c": 0.7}, rel=5e-3)


PROBLEM = """
kind = "identification"
robot = "pushed.py:Pushed"
free = ["M", "F_v", "F_c", "gain"]
[filter]
cutoff_Hz = 30.0
[log]
files = ["log.csv"]
position = { column = "carriage", unit = "mm" }
effort = { column = "drive", unit = "N" }
inputs = { push = { column = "pulses", unit = "kN" } }
"""


@pytest.fixture
def folder(tmp_path: Path, log: gt.Trajectory) -> Path:
    columns = np.column_stack([log.time, 1e3 * log["q"], log["tau"], 1e-3 * log["push"]])
    header = "time,carriage,drive,pulses"
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header=header, comments="", fmt="%.12g")
    source = Path(__file__).read_text()
    body = source[source.index("class Pushed") : source.index("class Loaded")]
    (tmp_path / "pushed.py").write_text(f"import gtmodel as gt\n\n\n{body}")
    (tmp_path / "pushed.toml").write_text(PROBLEM)
    return tmp_path


def test_a_problem_file_names_them_on_its_log(folder: Path, study) -> None:
    context = Context(folder=folder)
    done = answer(load(folder / "pushed.toml"), context)
    assert done.values["parameters"] == pytest.approx(study.parameters, rel=1e-6)
    text = explaining.of(str(folder / "pushed.toml"))
    assert "from q, der(q), der(q,2), push;" in text


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("push = {", "pull = {", r"^log.inputs.pull: Pushed has no variable 'pull'"),
        ('"pulses"', '"pulse"', r"^log: .*log.csv line 1: there is no column 'pulse'; did you mean 'pulses'"),
        ('unit = "kN"', 'unit = "kg"', r"^log.inputs.push: "),
        ("inputs =", "input =", r"log.input: .*inputs"),
    ],
)
def test_a_wrong_input_is_named(folder: Path, old: str, new: str, sentence: str) -> None:
    (folder / "pushed.toml").write_text(PROBLEM.replace(old, new))
    with pytest.raises(InputError, match=sentence):
        answer(load(folder / "pushed.toml"), Context(folder=folder))


def test_a_log_without_them_and_a_synthetic_one_are_refused(log: gt.Trajectory) -> None:
    without = gt.Trajectory(log.time, {n: log[n] for n in ("q", "tau")}, {"q": "m", "tau": "N"})
    with pytest.raises(gt.results.ArgumentError, match="no signal 'push'"):
        gt.identify.study(Pushed(), without, ["M"], fitting=WITH)
    synthetic = gt.identify.SyntheticLog(reference="q", centre=[0.0], tracking="exact", effort_noise=0.5)
    with pytest.raises(gt.results.ArgumentError, match="is for measured logs"):
        gt.identify.synthetic_study(Pushed(), synthetic, ["M"], fitting=WITH)
