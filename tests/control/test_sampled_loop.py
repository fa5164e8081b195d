"""Laws at samples: linear plants against matrices, the L1 against an independent integration and the law's C."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.cgen.interface import interfaces
from gtmodel.cgen.verification.comparison import call
from gtmodel.compiler.toolchain import find
from gtmodel.control import ComputedTorque, Feedback, law_causal, law_function, sampled_loop, track

PERIOD = 0.004
EXACT = 1e-9


class Cart(gt.Model):
    m = gt.parameter(2.0, unit="kg", positive=True)
    q = gt.variable(1, unit="m")
    tau = gt.input(1, unit="N")

    def equations(self):
        yield self.m * gt.der(self.q, 2) == self.tau


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0, 2.0, 2.3])
def test_a_cart_under_feedback_at_samples(share: float) -> None:
    """Positions at the samples against the exact solution of pieces of constant force."""
    period, delay, kp, kd, m = 0.02, share * 0.02, 200.0, 30.0, 2.0
    loop = sampled_loop(Cart(), Feedback(kp, kd), period, delay, first=3.0)
    run = gt.simulate(loop, 1.0, inputs={"reference": [0.1]}, start={"plant.q": 0.0, "der(plant.q)": 0.0})
    samples = run.samples["law"]
    x, v, forces = 0.0, 0.0, []
    for k in range(len(samples)):
        assert abs(samples["position"][k, 0] - x) < EXACT
        forces.append(kp * (0.1 - x) - kd * v)
        # pieces of this period, and which sample's force acts in each
        whole, part = divmod(round(share * 1000), 1000)
        for span, n in ((part / 1000 * period, k - whole - 1), (period - part / 1000 * period, k - whole)):
            f = forces[n] if n >= 0 else 3.0
            x, v = x + v * span + f / m * span**2 / 2, v + f / m * span


# -- the L1 under computed torque: 4 ms, two cycles late -------------------------------------------

ROBOT = gt.robots.gantry_tau("l1_tape", "model_2")
LAW = ComputedTorque(ROBOT, stiffness=900.0, damping=60.0)
FROM, BY = np.array([0.5, -0.9, 0.3]), np.array([0.2, 0.1, 0.1])


def reference(duration: float = 0.4, share: float = 1.0) -> gt.Trajectory:
    t = PERIOD * np.arange(round(duration / PERIOD) + 1)
    s = t / t[-1]
    place = 10 * s**3 - 15 * s**4 + 6 * s**5
    q, status = ROBOT.causal("T", "q")(FROM + share * place[:, None] * BY)
    assert not status.any()
    return gt.Trajectory(t, {"q": q}, {"q": "m"}, synthetic="no noise")


REFERENCE = reference()
START = {"T": FROM, "der(T)": np.zeros(3)}


@pytest.fixture(scope="module")
def tracked() -> gt.control.Tracked:
    return track(ROBOT, LAW, REFERENCE, START, period=PERIOD, delay=2 * PERIOD, tolerance=1e-10)


def rows(samples: gt.Trajectory, names: list[str]) -> np.ndarray:
    return np.hstack([samples[name] for name in names])


def test_the_laws_bytes_are_those_of_the_c_of_a_controller(tracked: gt.control.Tracked, tmp_path: Path) -> None:
    """The folder that `gt.cgen` writes for a real controller, in lock step with the simulation's samples."""
    function = law_causal(LAW, 3)
    made = gt.cgen.generate({"law": function}, tmp_path / "c", name="controller")
    tools = find()
    assert not isinstance(tools, str), tools
    sources = [path for path in sorted(made.folder.glob("*.c")) if not path.name.endswith("_main.c")]
    objects = []
    for path in sources:
        objects.append(tmp_path / f"{path.name}.o")
        good, said = tools.compile(path, objects[-1])
        assert good, said
    good, said = tools.link_shared(objects, tmp_path / "law.so")
    assert good, said
    (face,) = interfaces({"law": function}, "controller")
    library = ctypes.CDLL(str(tmp_path / "law.so"))
    samples = tracked.samples
    assert samples is not None and len(samples) == 101
    forces, status = call(library, face, rows(samples, [s.name for s in function.inputs]))
    assert not status.any()
    assert forces.tobytes() == samples["forces"].tobytes()
    assert np.ptp(samples["forces"], axis=0).min() > 50.0


def test_the_simulation_by_the_laws_c_has_the_same_bytes(tracked: gt.control.Tracked) -> None:
    same = track(ROBOT, LAW, REFERENCE, START, period=PERIOD, delay=2 * PERIOD, tolerance=1e-10, compiled=True)
    assert same.samples == tracked.samples
    assert same.trajectory == tracked.trajectory


def test_the_plant_is_what_another_integrator_makes_of_the_held_forces(tracked: gt.control.Tracked) -> None:
    """DOP853 of SciPy, anew from each sample, on the forward dynamics, with forces of two samples before."""
    forward = ROBOT.causal(known="tau", targets="der(T,2)", prefer="T")
    carts = ROBOT.causal(known="T", targets=["q", "der(q)"])

    def rate(_: float, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        acceleration, status = forward(*[{"T": x[:3], "der(T)": x[3:], "tau": tau}[s.name] for s in forward.inputs])
        assert status == 0
        return np.concatenate([x[3:], acceleration])

    samples = tracked.samples
    assert samples is not None
    x, forces, law = np.concatenate([FROM, np.zeros(3)]), [np.zeros(3)] * 2, law_function(LAW, 3)
    for k in range(len(samples)):
        q, dq, _ = carts(x[:3], x[3:])
        assert np.max(np.abs(samples["position"][k] - q)) < EXACT
        assert np.max(np.abs(samples["velocity"][k] - dq)) < 10 * EXACT
        wanted = [samples[n][k] for n in ("reference", "reference_rate", "reference_acceleration")]
        forces.append(law(*wanted, q, dq).full().reshape(-1))
        made = scipy.integrate.solve_ivp(rate, (0, PERIOD), x, "DOP853", args=(forces[k],), rtol=1e-11, atol=1e-12)
        x = made.y[:, -1]


def test_short_periods_without_delay_come_to_continuous_time() -> None:
    """By their first order: half the period, half the difference."""
    far, motion = START | {"T": FROM + 0.005}, reference(0.08, 0.04)
    continuous = track(ROBOT, LAW, motion, far, tolerance=1e-9)
    off = []
    for period in (0.004, 0.002):
        run = track(ROBOT, LAW, motion, far, period=period, delay=0.0, tolerance=1e-9)
        off.append(np.max(np.abs(run.trajectory["position"] - continuous.trajectory["position"])))
    assert 1e-6 < off[0] < 1e-3
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.1)


def test_delay_costs_accuracy() -> None:
    rms = [
        track(ROBOT, LAW, reference(0.16, 0.1), START | {"T": FROM + 0.002}, period=PERIOD, delay=n * PERIOD).rms.max()
        for n in (0, 2)
    ]
    assert 1.05 * rms[0] < rms[1] < 3 * rms[0]


# -- measurement -----------------------------------------------------------------------------------


def test_encoders_of_a_resolution_and_the_difference_of_their_positions() -> None:
    law, resolution = Feedback(200.0, 30.0), 1e-4
    options = {"resolution": resolution, "velocity": "difference", "delay": 0.0}
    motion = gt.Trajectory([0.0, 0.1, 0.2, 0.3], {"q": np.array([[0.0], [0.02], [0.03], [0.05]])}, {"q": "m"})
    samples = track(Cart(), law, motion, {"q": 0.0, "der(q)": 0.0}, period=0.01, **options).samples
    assert samples is not None
    measured = resolution * np.round(samples["position"] / resolution)
    speed = np.vstack([[0.0], np.diff(measured, axis=0) / 0.01])
    expected = 200.0 * (samples["reference"] - measured) + 30.0 * (samples["reference_rate"] - speed)
    np.testing.assert_allclose(samples["forces"], expected, atol=1e-12)
    assert np.max(np.abs(speed - samples["velocity"])) > 1e-3


# -- what does not fit -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"resolution": -1e-6}, "the encoder resolution must be .*; found -1e-06"),
        ({"velocity": "filtered"}, "'measured' or 'difference'; found 'filtered'"),
        ({"first": [1.0, 2.0]}, "the first forces must be one finite number, or 1 numbers"),
        ({"known": "x"}, "must declare 'x' and 'tau' as vectors"),
    ],
)
def test_what_a_sampled_loop_does_not_take(options: dict, said: str) -> None:
    with pytest.raises(gt.ModelError, match=said):
        sampled_loop(Cart(), Feedback(1.0, 1.0), **options)


@pytest.mark.parametrize(("period", "said"), [(0.0, "period"), (-0.004, "period"), (float("nan"), "period")])
def test_a_period_that_is_none(period: float, said: str) -> None:
    with pytest.raises(gt.ModelError, match=said):
        gt.simulate(sampled_loop(Cart(), Feedback(1.0, 1.0), period), 0.1, inputs={"reference": [0.0]})


def test_arguments_of_samples_need_a_period() -> None:
    motion = gt.Trajectory([0.0, 0.1, 0.2], {"q": np.zeros((3, 1))}, {"q": "m"})
    with pytest.raises(TypeError, match="accepts delay only for a sampled law"):
        track(Cart(), Feedback(1.0, 1.0), motion, {"q": 0.0, "der(q)": 0.0}, delay=0.004)


def test_without_a_compiler_the_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no_such_compiler")
    with pytest.raises(gt.ModelError, match="compiled=True needs a C compiler, but there is no C compiler"):
        sampled_loop(Cart(), Feedback(1.0, 1.0), compiled=True)
