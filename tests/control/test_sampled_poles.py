"""The linearised sampled loop against control.c2d, exact samples of a linear plant, and small motions of the L1."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.control import Feedback, linearize_sampled, sampled_loop
from tests.control.test_sampled_loop import FROM, LAW, PERIOD, ROBOT, Cart

EXACT = 1e-9
AT = {"q": [0.0], "der(q)": [0.0]}


def test_without_delay_the_poles_are_those_of_c2d_and_feedback() -> None:
    kp, kd, m, period = 200.0, 30.0, 2.0, 0.02
    plant = control.c2d(control.ss([[0, 1], [0, 0]], [[0], [1 / m]], np.eye(2), 0), period)
    closed = np.asarray(plant.A) - np.asarray(plant.B) @ [[kp, kd]]
    loop = linearize_sampled(Cart(), Feedback(kp, kd), period, 0.0, start=AT)
    assert loop.dt == period
    np.testing.assert_allclose(np.sort_complex(loop.poles()), np.sort_complex(np.linalg.eigvals(closed)), atol=EXACT)
    # the reference, held still, is reached: unit gain to the positions, none to the rate
    np.testing.assert_allclose(np.asarray(control.dcgain(loop))[0, :2], [1.0, kd / kp], atol=1e-8)


@pytest.mark.parametrize("velocity", ["measured", "difference"])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0, 2.3])
def test_samples_of_a_linear_plant_follow_it(share: float, velocity: str) -> None:
    """The simulation's samples, forces that still have to act among them, from one sample to the next."""
    period, law = 0.02, Feedback(200.0, 30.0)
    options: dict[str, Any] = {"velocity": velocity}
    loop = linearize_sampled(Cart(), law, period, share * period, start=AT, **options)
    model = sampled_loop(Cart(), law, period, share * period, **options)
    run = gt.simulate(model, 0.4, inputs={"reference": [0.0]}, start={"plant.q": 0.01, "der(plant.q)": 0.0})
    s = run.samples["law"]
    late = int(np.ceil(share - 1e-9))

    def state(k: int) -> np.ndarray:
        held = [s["forces"][k - j, 0] for j in range(1, late + 1)]
        return np.array(
            [s["position"][k, 0], s["velocity"][k, 0], *held, *[s["position"][k - 1, 0]] * (velocity[0] == "d")]
        )

    assert loop.state_labels[:2] == ["q[0]", "der(q[0])"]
    for k in range(4, 20):
        assert np.max(np.abs(np.asarray(loop.A) @ state(k) - state(k + 1))[:2]) < EXACT
        assert np.max(np.abs(np.asarray(loop.A) @ state(k) - state(k + 1))) < 1e3 * EXACT  # forces: gain times those


def test_small_motions_of_the_l1_follow_it() -> None:
    """Two simulations that begin 1e-6 m apart, a delay of 1.5 cycles."""
    delay, apart = 0.006, np.array([1e-6, -2e-6, 1.5e-6])
    loop = linearize_sampled(ROBOT, LAW, PERIOD, delay, start={"T": FROM, "der(T)": np.zeros(3)})
    q, _ = ROBOT.causal("T", "q")(FROM)
    first = gt.control.law_function(LAW, 3)(q, np.zeros(3), np.zeros(3), q, np.zeros(3)).full().reshape(-1)
    model = sampled_loop(ROBOT, LAW, PERIOD, delay, first=first)
    positions = []
    for shift in (0.0 * apart, apart):
        start = {"plant.T": FROM + shift, "der(plant.T)": np.zeros(3)}
        run = gt.simulate(model, 0.12, inputs={"reference": q}, start=start, tolerance=1e-12)
        positions.append(run.samples["law"]["position"])
    moved = positions[1] - positions[0]
    x = np.zeros(len(loop.A))
    x[[loop.state_labels.index(f"T[{i}]") for i in range(3)]] = apart
    for row in moved:
        assert np.max(np.abs(np.asarray(loop.C) @ x - row)) < 2e-4 * np.max(np.abs(moved))
        x = np.asarray(loop.A) @ x


def test_a_late_loop_is_unstable_where_the_poles_say_so() -> None:
    """Computed torque makes each actuator a double integrator: friction aside."""
    radius = [
        max(abs(linearize_sampled(ROBOT, LAW, PERIOD, d, start={"T": FROM, "der(T)": np.zeros(3)}).poles()))
        for d in (0.0, 0.008, 0.02, 0.05)
    ]
    assert radius[0] < radius[1] < 1.0 < radius[3] and radius == sorted(radius)


@pytest.mark.parametrize(
    ("change", "said"),
    [({"period": 0.0}, "the period must be"), ({"delay": -1.0}, "the delay not negative"), ({"known": "x"}, "'x'")],
)
def test_what_it_does_not_take(change: dict, said: str) -> None:
    args: dict[str, Any] = {"start": AT} | change
    with pytest.raises(gt.ModelError, match=said):
        linearize_sampled(Cart(), Feedback(1.0, 1.0), **args)


def test_the_point_is_at_rest() -> None:
    with pytest.raises(gt.ModelError, match="a point at rest"):
        linearize_sampled(Cart(), Feedback(1.0, 1.0), start={"q": [0.0], "der(q)": [1.0]})
