"""Receptance from hammer records: exact without noise, honest about noise, sentences for bad records."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.vibration import FrequencyResponse, command_force, frequency_response, receptance, synthetic_hits

M, C, K = 174.8, 4047.9, 2.79e6  # Cvitanic 2021, Table 16, test 2, x
RATE = 1024.0
# the hit is simulated with straight pieces of an eighth of a sample: (pi f / 8 rate)^2 / 3 at 60 Hz, and folding
SAMPLED = 5e-4


def hits(noise: float = 0.0, seed: int = 1, count: int = 5, **more):
    return synthetic_hits(M, C, K, sample_rate=RATE, duration=2.0, hits=count, noise=noise, seed=seed, **more)


@pytest.mark.parametrize("measures", ["acceleration", "velocity", "displacement"])
@pytest.mark.parametrize("decay", [0.0, 6.0])
@pytest.mark.parametrize("estimator", ["H1", "H2"])
def test_hits_without_noise_give_the_receptance(measures, decay, estimator) -> None:
    F, x = hits(measures=measures)
    found = frequency_response(F, x, RATE, measures=measures, decay=decay, estimator=estimator)
    # an acceleration folded down from beyond half the rate is not small against that of a few hertz
    found = found.between(11.0 if measures == "acceleration" else 5.0, 60.0)
    true = receptance(found.s, *np.array([[M], [C], [K]]))
    # with a window H is that at s = j omega + decay, not an approximation to that without
    np.testing.assert_allclose(found.receptance, true, rtol=SAMPLED)
    assert np.all(found.coherence > 1 - 1e-9)


def test_the_response_to_a_hit_is_that_of_an_integrator() -> None:
    from scipy.integrate import solve_ivp

    F, x = hits(measures="displacement", count=1)
    width = 0.012
    # its peak lies between two samples
    peak = F[0, 6] / ((1 - np.cos(2 * np.pi * 6 / RATE / width)) / 2)

    def force(t):
        return peak * (1 - np.cos(2 * np.pi * t / width)) / 2 if t < width else 0.0

    times = np.arange(300) / RATE
    found = solve_ivp(
        lambda t, y: [y[1], (force(t) - C * y[1] - K * y[0]) / M], (0, times[-1]), [0, 0], t_eval=times, max_step=5e-4,
        rtol=1e-9, atol=1e-15,
    )  # fmt: skip
    np.testing.assert_allclose(x[0, :300], found.y[0], atol=1e-3 * np.abs(x).max())


def test_variance_is_that_of_the_scatter_and_falls_with_the_hits() -> None:
    def scatter(count: int) -> tuple[np.ndarray, np.ndarray]:
        found = [frequency_response(*hits(0.2, s, count), RATE).between(12.0, 40.0) for s in range(30)]
        error = np.array([f.receptance - receptance(f.s, *np.array([[M], [C], [K]])) for f in found])
        return np.mean(np.abs(error) ** 2, axis=0), np.mean([f.variance for f in found], axis=0)

    (few, said_few), (many, said_many) = scatter(3), scatter(12)
    # 30 runs of 57 lines: the ratio is known within 5 % (two standard errors)
    assert np.mean(few / said_few) == pytest.approx(1.0, abs=0.1)
    assert np.mean(many / said_many) == pytest.approx(1.0, abs=0.1)
    assert np.mean(few) / np.mean(many) == pytest.approx(4.0, rel=0.25)


def test_h1_is_right_for_noise_on_the_response_and_h2_for_noise_on_the_force() -> None:
    F, x = hits(count=40)
    rng = np.random.default_rng(0)
    line = slice(30, 60)
    true = None
    bias = {}
    for where in ("force", "response"):
        noisy_F = F + (30.0 * rng.standard_normal(F.shape) if where == "force" else 0)
        noisy_x = x + (0.3 * rng.standard_normal(x.shape) if where == "response" else 0)
        for estimator in ("H1", "H2"):
            found = frequency_response(noisy_F, noisy_x, RATE, estimator=estimator)
            true = receptance(found.s, *np.array([[M], [C], [K]]))[line]
            bias[where, estimator] = float(np.mean(np.abs(found.receptance[line]) / np.abs(true))) - 1
    assert abs(bias["response", "H1"]) < 0.02 and bias["response", "H2"] > 0.03
    assert abs(bias["force", "H2"]) < 0.02 and bias["force", "H1"] < -0.03


def test_a_force_window_takes_noise_off_the_force() -> None:
    F, x = hits(count=3)
    noisy = F + 20.0 * np.random.default_rng(3).standard_normal(F.shape)
    errors = []
    for window in (None, 0.03):
        found = frequency_response(noisy, x, RATE, force_window=window).between(10.0, 40.0)
        errors.append(np.abs(found.receptance / receptance(found.s, *np.array([[M], [C], [K]])) - 1).max())
    assert errors[1] < errors[0] / 3


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda F, x: (F, x[:, :-1]), r"force \(5, 2048\) and response \(5, 2047\) differ"),
        (lambda F, x: (np.full_like(F, np.nan), x), "not finite; leave that hit out"),
        (lambda F, x: (0 * F, x), "the force of hit 1 is zero throughout"),
        (lambda F, x: (F[:, :200], x[:, :200]), r"response of hit \d has not decayed: \d+% .* set a decay"),
        (
            lambda F, x: (F + 0.4 * np.roll(F, 100, axis=1), x),
            r"second peak of 40% of the first after the force window",
        ),
    ],
)
def test_bad_records_are_refused_with_a_sentence(change, said) -> None:
    with pytest.raises(ValueError, match=said):
        frequency_response(*change(*hits()), RATE, force_window=0.02)


def test_bad_responses_are_refused() -> None:
    f = np.array([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="above zero and ascending"):
        FrequencyResponse(f[::-1], f + 0j)
    with pytest.raises(ValueError, match="not finite"):
        FrequencyResponse(f, f * np.nan + 0j)
    with pytest.raises(ValueError, match=r"3 lines are between 1 and 3 Hz; expected 8"):
        FrequencyResponse(f, f + 0j).between(1.0, 3.0)


def test_a_commanded_step_is_an_impulse_of_its_size_by_the_cycle() -> None:
    cycle = 0.004
    F = command_force([0.0, 0.0, 1e-3, 1e-3, 1e-3], cycle)
    assert F.tolist() == [0.0, 0.0, 1e-3 / cycle**2, 0.0, 0.0]  # eq. (30)
    assert F.sum() * cycle**2 == pytest.approx(1e-3)
    with pytest.raises(ValueError, match="expected commands"):
        command_force([[0.0]], cycle)


def test_a_commanded_step_tells_frequency_and_damping_of_the_arm() -> None:
    """The scaled oscillator of section 5.3.4: m without unit, k in 1/s2; fn and zeta are the arm's."""
    from scipy import signal

    from gtmodel.vibration import fit_modes

    cycle, m, c, k = 0.004, 40.0, 600.0, 40 * (2 * np.pi * 17) ** 2  # the 17 Hz of Fig. 31
    command = np.where(np.arange(1000) >= 10, 1e-3, 0.0)
    F = command_force(command, cycle)
    step = signal.cont2discrete(([1 / m], [1, c / m, k / m]), cycle, method="zoh")
    x = signal.lfilter(np.ravel(step[0]), np.ravel(step[1]), F)
    # force constant over a cycle against samples: half a cycle of delay, taken back by the middle of two samples
    found = fit_modes(frequency_response(F, (x + np.roll(x, -1)) / 2, 1 / cycle, measures="displacement"), 1)
    assert found.fn[0] == pytest.approx(17.0, rel=2e-3) and found.zeta[0] == pytest.approx(
        c / 2 / np.sqrt(k * m), rel=0.02
    )


@pytest.mark.parametrize("estimator", ["H1", "H2"])
@pytest.mark.parametrize("width", [2, 4, 8])
def test_lines_without_force_are_left_out(estimator, width) -> None:
    # so many equal samples have no force at all at the multiples of rate / width
    n = 1024
    F = np.zeros((2, n))
    F[:, 5 : 5 + width] = [[1000.0], [1500.0]]
    f = np.fft.rfftfreq(n, 1 / RATE)
    true = receptance(2j * np.pi * f, *np.array([[10.0], [800.0], [1e6]]))
    x = np.fft.irfft(np.fft.rfft(F) * true, n)
    found = frequency_response(F, x, RATE, measures="displacement", estimator=estimator)
    silent = np.arange(1, width // 2 + 1) * RATE / width
    assert not np.isin(found.frequency, silent).any()
    # the record is one period, but for the Nyquist line it is exact
    kept = np.isin(f, found.frequency) & (f < RATE / 2)
    assert np.sum(kept) >= n // 2 - 1 - len(silent)
    np.testing.assert_allclose(found.receptance[found.frequency < RATE / 2], true[kept], rtol=1e-9)
    assert np.all(np.isfinite(found.coherence)) and np.all(np.isfinite(found.variance))


def test_a_response_that_is_zero_at_one_line_is_zero_there() -> None:
    F = np.zeros((1, 1024))
    F[0, 3] = 1000.0
    x = np.zeros((1, 1024))
    x[0, 5:7] = 1e-4  # nothing at half the rate
    found = frequency_response(F, x, RATE, measures="displacement")
    assert found.receptance[-1] == 0.0 and found.coherence[-1] == 0.0 and len(found.frequency) == 512
