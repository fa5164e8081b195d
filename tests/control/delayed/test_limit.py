"""The gain limit of a late loop: closed forms, simulations in time, the language's sampled blocks, python-control."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError

D = gt.control.delayed

CYCLE, LATE = 0.004, 0.052
EXACT = 1e-9  # round-off of a companion matrix of some 20 states
ROUND_OFF = 1e-10  # of a run, relative to its largest deviation: the Schur form of a growing loop
ON_CIRCLE = 1e-6
FIVE_PERCENT = 0.05


def arm(frequency: float = 17.0, zeta: float = 0.09, m: float = 3.0, cycle: float = CYCLE, **options: Any) -> Any:
    w = 2 * np.pi * frequency
    return D.equivalent_plant(m, 2 * zeta * w * m, w**2 * m, cycle, **options)


PLANTS = [arm(), arm(8.0, 0.03, 0.2), arm(22.0, 0.05, 1.0), arm(12.0, 0.002, 1.0)]


@pytest.mark.parametrize("cycles", [0, 1, 2, 5, 13, 40])
def test_of_a_rigid_arm_it_is_the_closed_form_of_an_integrator(cycles: int) -> None:
    limit = D.gain_limit(D.DelayedLoop(D.rigid_plant(CYCLE), CYCLE, cycles * CYCLE))
    assert limit.gain == pytest.approx(2 * np.sin(np.pi / (2 * (2 * cycles + 1))), abs=EXACT)
    assert limit.frequency == pytest.approx(1 / (2 * (2 * cycles + 1) * CYCLE), rel=1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.001, 0.004, 0.0505, 0.052, 0.0533])
@pytest.mark.parametrize("plant", PLANTS)
def test_at_the_limit_a_pole_is_on_the_unit_circle_and_none_outside_before(plant: Any, delay: float) -> None:
    loop = D.DelayedLoop(plant, CYCLE, delay)
    limit = D.gain_limit(loop)
    assert abs(loop.radius(limit.gain) - 1) < ON_CIRCLE
    # a scan that knows nothing of crossings
    assert all(loop.radius(limit.gain * share) < 1 for share in np.linspace(0.01, 0.999, 60))
    assert loop.radius(limit.gain * 1.001) > 1


@pytest.mark.parametrize("accumulate", [False, True])
def test_it_is_proportional_to_the_mass(accumulate: bool) -> None:
    # frequency and damping given; where corrections accumulate the arm itself has no mass, and it is not
    limits = [D.gain_limit(D.DelayedLoop(arm(m=m, accumulate=accumulate), CYCLE, LATE)).gain / m for m in (0.5, 3.0)]
    assert (abs(limits[0] / limits[1] - 1) < 1e-7) is not accumulate


@pytest.mark.parametrize(
    ("plant", "seconds"),
    [
        (PLANTS[0], 15.0),
        pytest.param(PLANTS[2], 15.0, marks=pytest.mark.proof),
        (arm(12.0, 0.05, 0.2), 15.0),
        pytest.param(PLANTS[1], 60.0, marks=pytest.mark.proof),
    ],
)
def test_a_run_along_the_sine_grows_beyond_it_alone(plant: Any, seconds: float) -> None:
    # the last plant, of 8 Hz and a damping ratio of 0.03, grows by e^1.3 alone in 15 s at a gain 5 % above its limit
    loop, path = D.DelayedLoop(plant, CYCLE, LATE), D.SinePath(duration=seconds)
    limit = D.gain_limit(loop).gain
    low, high = 0.5 * limit, 2.0 * limit
    assert D.run_along(loop, low, path).bounded and not D.run_along(loop, high, path).bounded
    while high - low > 0.005 * limit:
        middle = (low + high) / 2
        low, high = (middle, high) if D.run_along(loop, middle, path).bounded else (low, middle)
    assert abs(low / limit - 1) < FIVE_PERCENT


def test_a_return_to_stability_is_mentioned_and_not_taken() -> None:
    """A rigid arm under a law of three lags, each with a lead: conditionally stable at great gains."""
    lags = [control.ss([[-a]], [[a]], [[b]], [[1.0]]) for a, b in ((0.5, 30.0), (0.7, 40.0), (1.0, 50.0))]
    law = control.c2d(control.series(*lags), CYCLE)
    loop = D.DelayedLoop(D.rigid_plant(CYCLE), CYCLE, 0.0, law)
    limit = D.gain_limit(loop)
    ((low, high),) = limit.returns
    assert limit.gain < low < high < np.inf
    # a scan that knows nothing of crossings
    gains = np.geomspace(limit.gain / 30, 3 * high, 400)
    stable = np.array([loop.radius(g) < 1 for g in gains])
    assert np.array_equal(stable, (gains < limit.gain) | ((gains > low) & (gains < high)))


class Corrected(gt.Model):
    """The oscillator under corrections, and a block that makes them."""

    m = gt.parameter(3.0, unit="kg")
    c = gt.parameter(57.7, unit="N.s/m")
    k = gt.parameter(34200.0, unit="N/m")
    per_cycle = gt.parameter(1 / CYCLE**2, unit="N/m", description="mass of one by the square of the cycle")
    y = gt.variable(unit="m", start=1e-3, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)

    def equations(self) -> Any:
        yield gt.der(self.y) == self.v
        yield self.m * gt.der(self.v) + self.c * self.v + self.k * self.y == self.law.u * self.per_cycle
        yield self.law.y == self.y


class Proportional(gt.SampledBlock):
    """u = -P y."""

    gain = gt.parameter(0.2, unit="1")
    y = gt.input(unit="m")
    u = gt.output(unit="m")

    def step(self, inputs: Any, state: Any) -> dict[str, Any]:
        return {"u": -self.gain * inputs.y}


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.004, 0.0093, 0.052])
def test_the_languages_own_sampled_loop_follows_the_companion_matrix(delay: float) -> None:
    class Loop(Corrected):
        law = gt.part(Proportional, period=CYCLE, delay=delay, gain=0.2)

    run = gt.simulate(Loop(), 0.4, tolerance=1e-12)
    y, u = run.samples["law"]["y"].reshape(-1), run.samples["law"]["u"].reshape(-1)
    loop = D.DelayedLoop(D.equivalent_plant(3.0, 57.7, 34200.0, CYCLE), CYCLE, delay)
    x = np.zeros(len(loop.matrix(0.2)))
    x[0] = 1e-3
    for k in range(len(y)):
        assert abs(x[0] - y[k]) < EXACT * 1e-3
        assert abs(loop.correction(0.2, x) - u[k]) < EXACT * 1e-3
        x = loop.matrix(0.2) @ x


def test_the_response_is_that_of_python_control_and_of_the_matrix() -> None:
    loop = D.DelayedLoop(arm(), CYCLE, LATE)
    plant = control.c2d(control.ss(loop.plant.A, loop.plant.B[:, None], loop.plant.C[None], 0), CYCLE)
    w = np.array([1.0, 30.0, 107.0, 400.0])
    theirs = np.asarray(plant(np.exp(1j * w * CYCLE))) * np.exp(-13j * w * CYCLE)
    assert np.max(np.abs(loop.response(w) / theirs - 1)) < EXACT
    # det(z - M(P)) / det(z - M(0)) = 1 + P L(z), for any delay and law
    law = control.ss([[1.0]], [[CYCLE]], [[2.0]], [[1.0]], CYCLE)
    for late in (0.0, 0.0505):
        loop = D.DelayedLoop(arm(), CYCLE, late, law)
        for omega in w:
            z = np.exp(1j * omega * CYCLE)
            sizes = [np.linalg.det(z * np.eye(len(loop.matrix(p))) - loop.matrix(p)) for p in (0.3, 0.0)]
            assert abs(sizes[0] / sizes[1] - 1 - 0.3 * loop.response(np.array([omega]))[0]) < 1e-8


def test_an_integral_part_is_in_the_limit() -> None:
    law = control.ss([[1.0]], [[CYCLE]], [[2.0]], [[1.0]], CYCLE)  # 1 + 2 / s, at samples
    plain, more = (D.gain_limit(D.DelayedLoop(arm(), CYCLE, LATE, x)) for x in (None, law))
    assert more.gain != plain.gain
    loop = D.DelayedLoop(arm(), CYCLE, LATE, law)
    assert loop.radius(0.999 * more.gain) < 1 < loop.radius(1.001 * more.gain)


def test_a_run_is_the_plant_between_samples_with_pieces_of_the_delay() -> None:
    """Its samples against a matrix exponential of plant and held corrections in pieces of the delay."""
    loop, gain, path = D.DelayedLoop(arm(), CYCLE, 0.0093), 0.3, D.SinePath(duration=0.5)
    run, steering = D.run_along(loop, gain, path, noise=15e-6, seed=3), path.steering(CYCLE)
    noise = 15e-6 * np.random.default_rng(3).standard_normal(len(steering))
    A, B = loop.plant.A, loop.plant.B

    def over(span: float, x: np.ndarray, u: float) -> np.ndarray:
        block = scipy.linalg.expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * span)
        return block[:2, :2] @ x + block[:2, 2] * u

    x, made, most = np.zeros(2), [0.0] * 4, ROUND_OFF * np.abs(run.deviation).max()
    for k in range(len(steering)):
        assert abs(loop.plant.C @ x - run.deviation[k]) < most
        made.append(-gain * (loop.plant.C @ x + noise[k]))
        assert abs(made[-1] - run.correction[k]) < most
        # 9.3 ms: two cycles and 1.3 ms
        x = over(0.0013, x, made[-4] + steering[k])
        x = over(0.0027, x, made[-3] + steering[k])


@pytest.mark.parametrize(
    ("wrong", "argument"),
    [
        (lambda: D.DelayedLoop(arm(), 0.0, LATE), "cycle"),
        (lambda: D.DelayedLoop(arm(), CYCLE, -1.0), "delay"),
        (lambda: D.DelayedLoop(arm(), CYCLE, np.nan), "delay"),
        (lambda: D.DelayedLoop(arm(), 1e-6, 1.0), "delay"),
        (lambda: D.DelayedLoop(arm(), CYCLE, LATE, control.ss(0, 1, 1, 0, 0.01)), "law"),
        (lambda: D.equivalent_plant(-3.0, 1.0, 1.0, CYCLE), "m"),
        (lambda: D.equivalent_plant(3.0, -1.0, 1.0, CYCLE), "c"),
        (lambda: D.equivalent_plant(3.0, 1.0, 0.0, CYCLE), "k"),
        (lambda: D.rigid_plant(0.0), "cycle"),
        (lambda: D.linear_plant(control.ss(0, 1, 1, 0, 0.01)), "system"),
        (lambda: D.linear_plant(control.ss(0, 1, 1, 1)), "system"),
        (lambda: D.linear_plant(control.ss(np.eye(2), np.eye(2), np.eye(2), 0)), "direction"),
        (lambda: D.run_along(D.DelayedLoop(arm(), CYCLE, LATE), 0.1, D.SinePath(duration=0.1)), "path.duration"),
        (lambda: D.run_along(D.DelayedLoop(arm(), CYCLE, LATE), 0.1, noise=-1.0), "noise"),
        (lambda: D.run_along(D.DelayedLoop(arm(), CYCLE, LATE), 0.1, D.SinePath(amplitude=0.0), noise=0.0), "noise"),
        (lambda: D.gain_limit(D.DelayedLoop(D.CorrectedPlant([[1.0]], [1.0], [1.0]), CYCLE, 0.0)), ""),
        (lambda: D.side_by_side([arm()], [1.0, 2.0], [1.0]), ""),
    ],
)
def test_what_is_refused(wrong: Any, argument: str) -> None:
    with pytest.raises(ArgumentError) as fault:
        wrong()
    assert fault.value.argument == argument
