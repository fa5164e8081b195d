"""The family on linear problems: every filter is the Kalman filter; and what each of them refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.filtering import ErrorState, InitialState, Interacting, Readings, Sensor, System, make
from gtmodel.results.refusal import ArgumentError
from tests.support import turning_body as body
from tests.support.carts import START, cart_log, cart_system

SAME = 1e-9  # standard deviations; of the log-likelihood relative


@pytest.fixture(scope="module")
def cart() -> System:
    return cart_system()


def of(name: str, system: System, **options: Any) -> Any:
    return make(name, [system, system.with_(), system.with_()] if name == "imm" else system, **options)


@pytest.mark.parametrize("runs", [None, 3])
@pytest.mark.parametrize("name", ["ekf", "iekf", "ukf", "imm"])
def test_of_a_linear_system_they_are_the_kalman_filter(name, runs, cart):
    # uneven steps, two rates, missing numbers
    _, _, log = cart_log(11, 60, runs)
    exact, other = (of(n, cart).run(log, START, keep=True) for n in ("kf", name))
    assert np.max(np.abs(other.x - exact.x) / exact.deviations) < SAME
    scale = exact.deviations if runs else exact.deviations[:, 0]
    scale = np.swapaxes(scale, 0, 1) if runs else scale
    apart = (other.covariances - exact.covariances) / scale[..., :, None] / scale[..., None, :]
    assert np.max(np.abs(apart)) < SAME
    assert np.allclose(other.log_likelihood, exact.log_likelihood, rtol=SAME)
    assert np.allclose(other.nis, exact.nis, rtol=0, atol=1e-8) and np.array_equal(other.count, exact.count)


@pytest.mark.parametrize("name", ["ukf", "imm"])
def test_they_smooth_or_say_that_they_do_not(name, cart):
    _, _, log = cart_log(12, 30)
    run = of(name, cart).run(log, START)
    if name == "imm":
        with pytest.raises(ArgumentError, match="run ErrorState over the log"):
            gt.filtering.smooth(run)
        return
    exact = gt.filtering.smooth(make("kf", cart).run(log, START))
    smoothed = gt.filtering.smooth(run)
    assert np.max(np.abs(smoothed.x - exact.x) / exact.deviations) < 1e-7
    assert np.allclose(smoothed.deviations, exact.deviations, rtol=1e-7)


@pytest.mark.parametrize("name", ["kf", "ukf", "imm", "particle"])
def test_a_stream_through_the_buffer_is_the_log(name, cart):
    time, _, log = cart_log(13, 20)
    start = InitialState(START.mean, START.deviation, time=float(time[0]))
    options = {"particles": 100} if name == "particle" else {}
    sorted_data = of(name, cart, **options).run(log, start)
    buffer = gt.filtering.Buffer(of(name, cart, **options), start, 10.0)
    stamps = [(float(t), sensor, k) for sensor, r in log.items() for k, t in enumerate(r.time)]
    for t, sensor, k in sorted(stamps, key=lambda s: s[0] + 0.31 * (s[1] == "tape")):  # the tape comes late
        buffer.push(sensor, t, log[sensor].values[k])
    streamed = buffer.filtered()
    assert np.array_equal(streamed.x, sorted_data.x)
    assert np.array_equal(streamed.deviations, sorted_data.deviations)
    for detail in ("mode_probabilities", "effective"):
        a, b = getattr(streamed, detail), getattr(sorted_data, detail)
        assert (a is None and b is None) or np.array_equal(a, b)


class TestInteracting:
    def switching(self) -> tuple[list[System], dict[str, Readings]]:
        """Quiet, then driven hard, then quiet again (synthetic)."""
        base = cart_system()
        systems = [base.with_(noise={"jerk": 1e-4}), base.with_(noise={"jerk": 10.0})]
        rng = np.random.default_rng(8)
        t = 0.05 * np.arange(300)
        jerk = np.where((t > 5) & (t < 8), rng.normal(size=300) * np.sqrt(10.0 / 0.05), 0.0)
        a = np.cumsum(jerk) * 0.05
        a = np.where(t >= 8, 0.0, a)
        v = np.cumsum(a) * 0.05
        x = np.cumsum(v) * 0.05
        tape = Readings(t, x + 0.01 * rng.normal(size=300))
        return systems, {"tape": tape, "unit": Readings(t, a + 0.05 * rng.normal(size=300))}

    def test_the_right_mode_is_known_and_the_log_is_likelier_than_of_either(self):
        systems, log = self.switching()
        run = make("imm", systems, stay=0.98).run(log, START)
        fast = run.mode_probabilities[:, 0, 1]
        assert np.allclose(run.mode_probabilities.sum(axis=2), 1.0, rtol=0, atol=1e-12)
        assert np.median(fast[(run.time > 5.3) & (run.time < 8)]) > 0.9
        assert np.median(fast[(run.time > 2) & (run.time < 5)]) < 0.1
        alone = [make("kf", system).run(log, START).log_likelihood[0] for system in systems]
        assert run.log_likelihood[0] > max(alone) + 10

    def test_without_a_change_of_mode_it_is_the_mixture_of_both_filters(self):
        # the chance to stay is 1: Bayes' rule over two whole filters, by hand
        systems, log = self.switching()
        run = make("imm", systems, stay=1.0, probabilities=[0.7, 0.3]).run(log, START)
        alone = [make("kf", system).run(log, START) for system in systems]
        logs = np.array([np.log(0.7), np.log(0.3)]) + [a.log_likelihood[0] for a in alone]
        most = logs.max()
        assert run.log_likelihood[0] == pytest.approx(most + np.log(np.exp(logs - most).sum()), rel=1e-10)
        p = np.exp(logs - most) / np.exp(logs - most).sum()
        assert run.mode_probabilities[-1, 0] == pytest.approx(p, abs=1e-9)
        assert run.x[-1, 0] == pytest.approx(p[0] * alone[0].x[-1, 0] + p[1] * alone[1].x[-1, 0], rel=1e-8)

    def test_a_gate_is_of_the_mixture(self):
        system = cart_system(gate=0.999)
        _, _, log = cart_log(14, 60)
        log["tape"].values[5] += 5.0
        runs = [make("kf", system).run(log, START), Interacting([system, system.with_()]).run(log, START)]
        assert runs[0].gated["tape"] == runs[1].gated["tape"] == 1
        assert np.max(np.abs(runs[0].x - runs[1].x) / runs[0].deviations) < SAME

    def test_modes_may_differ_in_the_noise_of_a_sensor(self):
        # one mode alone has all the probability: its filter, whatever the other one's deviations are
        base = cart_system()
        rough = base.with_(deviations={"tape": 0.1})
        _, _, log = cart_log(15, 30)
        run = Interacting([base, rough], stay=np.eye(2), probabilities=[0.0, 1.0]).run(log, START)
        alone = make("kf", rough).run(log, START)
        assert np.max(np.abs(run.x - alone.x) / alone.deviations) < SAME
        assert run.nis == pytest.approx(alone.nis, abs=1e-9)
        assert run.log_likelihood[0] == pytest.approx(alone.log_likelihood[0], rel=SAME)


class TestUnscented:
    def test_of_a_turning_body_it_agrees_with_the_extended_filter(self):
        t = 0.001 * np.arange(200)
        system, log = body.tracked(), body.noisy(t, 6)
        a, b = (make(name, system).run(log, body.beginning()) for name in ("ekf", "ukf"))
        apart = np.abs(system.space.minus(a.x[:, 0], b.x[:, 0])) / a.deviations[:, 0]
        assert apart.max() < 0.02
        assert np.allclose(a.deviations, b.deviations, rtol=1e-3)

    def test_mean_and_variance_of_a_square(self):
        # of z = x^2, x ~ N(m, s^2): mean m^2 + s^2, covariance with x 2 m s^2: Gaussian moments by hand
        parts = [gt.filtering.StatePart("x")]
        process = gt.filtering.DiscreteProcess(parts, 1.0, lambda s: {"x": s.x}, [0.0], {"z": lambda s: s.x**2})
        system = System(process, [Sensor("z", deviation=0.1)])
        m, s, z = 1.5, 0.2, 2.6
        filter = make("ukf", system, centre=2 / 3)  # n / (1 - centre) = 3: the fourth moment of a Gaussian too
        run = filter.run({"z": Readings([0.0], [z])}, InitialState({"x": m}, {"x": s}))
        S = 4 * m**2 * s**2 + 2 * s**4 + 0.1**2
        gain = 2 * m * s**2 / S
        assert run["x"][0] == pytest.approx(m + gain * (z - m**2 - s**2), rel=1e-12)
        assert run.deviation["x"][0] ** 2 == pytest.approx(s**2 - gain**2 * S, rel=1e-10)

    def test_a_state_that_is_known_exactly_stays_known(self, cart):
        _, _, log = cart_log(16, 20)
        start = InitialState({}, {"x": 0.1, "v": 0.5, "a": 1.0, "b": 0.0})
        runs = [make(name, cart.with_(noise={"drift": 0.0})).run(log, start) for name in ("kf", "ukf")]
        assert np.max(np.abs(runs[0].x - runs[1].x)) < 1e-11
        assert np.all(runs[1].deviation["b"] == 0.0)


REFUSALS = [
    ("nonsense", {}, "there is no filter 'nonsense'; .* 'kf'"),
    ("complementary", {}, "takes two signals"),
    ("imm", {}, "'imm' takes a list of systems"),
    ("ukf", {"centre": 1.0}, "weight between 0 and 1"),
    ("ukf", {"center": 0.5}, "'ukf' has no option 'center'; it has 'centre'"),
    ("kf", {"particles": 3}, "'kf' has no option 'particles'"),
    ("particle", {"particles": 1}, "at least 2"),
    ("particle", {"proposal": "prior"}, "'optimal' or 'bootstrap'"),
    ("additive", {}, r"such as quaternions=\['Q'\]"),
    ("additive", {"quaternions": ["x"]}, "expected four plain numbers for 'x'"),
    ("steady", {}, "no period"),
    ("iekf", {"iterations": 0}, "at least 1"),
]


@pytest.mark.parametrize(("name", "options", "sentence"), REFUSALS)
def test_refusals(name, options, sentence, cart):
    with pytest.raises(ArgumentError, match=sentence):
        make(name, cart, **options)


def test_refusals_of_systems(cart):
    with pytest.raises(ArgumentError, match="'imm' for several"):
        make("kf", [cart, cart])
    with pytest.raises(ArgumentError, match="two or more systems"):
        make("imm", [cart])
    with pytest.raises(ArgumentError, match="system 1 has other states or sensors"):
        make("imm", [cart, body.tracked()])
    with pytest.raises(ArgumentError, match="rows that sum to 1"):
        make("imm", [cart, cart], stay=1.5)
    with pytest.raises(ArgumentError, match="sum to 1"):
        make("imm", [cart, cart], probabilities=[0.5, 0.6])
    for name in ("kf", "steady"):
        with pytest.raises(ArgumentError, match="linear process and linear sensors"):
            make(name, body.tracked())


def test_every_filter_gives_the_same_kind_of_answer():
    # one call for all of them; of the particle filter within what its number allows
    t = 0.1 * np.arange(40)
    rng = np.random.default_rng(1)
    log = {"tape": Readings(t, 0.01 * rng.normal(size=40)), "unit": Readings(t, 0.05 * rng.normal(size=40))}
    runs = {
        name: of(name, cart_system(period=0.1)) for name in ("kf", "ekf", "iekf", "ukf", "imm", "particle", "steady")
    }
    answers = {name: filter.run(log, START) for name, filter in runs.items()}
    exact = answers["kf"]
    for name, run in answers.items():
        assert run.status == gt.results.SolveStatus.SOLVED
        assert run.x.shape == exact.x.shape and run.trajectory().names == exact.trajectory().names
        assert isinstance(runs[name], gt.filtering.Filter)
        assert (run.mode_probabilities is None) == (name != "imm")
        assert (run.effective is None) == (name != "particle")
        assert np.max(np.abs(run.x - exact.x)[-1] / exact.deviations[-1]) < 0.5
    assert isinstance(runs["ekf"], ErrorState)
