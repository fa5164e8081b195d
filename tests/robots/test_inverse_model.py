"""The inverse model behind its filters: causal, and equal to the unfiltered inverse dynamics."""

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.robots.inverse_model import InverseModel

# the same equations solved in another order
ROUND_OFF = 1e-10


@pytest.fixture(scope="module")
def robot() -> gt.Model:
    return gt.robots.gantry_tau("l1_tape")


def test_block_needs_no_derivative_of_its_input_and_equals_the_inverse_dynamics(robot: gt.Model) -> None:
    rates = [f"der(filter[{i}].x)" for i in range(3)]
    motion = ["robot.q", "der(robot.q)", "der(robot.q,2)"]
    block = InverseModel(robot=robot).causal(known="reference", targets=["tau", *rates, *motion])
    assert [s.name for s in block.inputs] == ["filter[0].x", "filter[1].x", "filter[2].x", "reference"]
    q0 = robot.causal(known="T", targets="q")([0.5, -0.9, 0.3])[0]
    rng = np.random.default_rng(0)
    states = [q0[i] + 1e-3 * rng.standard_normal((50, 3)) for i in range(3)]
    reference = q0 + 1e-3 * rng.standard_normal((50, 3))
    tau, *dx, q, dq, ddq, status = block(*states, reference)
    assert not status.any()
    for i in range(3):  # three equal lags in a row
        before = np.column_stack([reference[:, i], states[i][:, :2]])
        np.testing.assert_allclose(dx[i], 100.0 * (before - states[i]), rtol=ROUND_OFF, atol=ROUND_OFF)
    inverse = robot.causal(known="q", targets="tau")
    expected, ok = inverse(q, dq, ddq)
    assert not ok.any()
    np.testing.assert_allclose(tau, expected, rtol=ROUND_OFF, atol=ROUND_OFF * np.abs(expected).max())
