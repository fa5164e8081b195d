"""Serial arms from joints and rigid bodies against pinocchio."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel import Status
from tests.mechanics.arms import ArmData, industrial_arm, random_arm
from tests.support.compare import relative_error
from tests.support.residuals import original_residuals

pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of serial arms, is not installed")

# Two recursions of some thousand operations on accelerations and forces of order 1 to 1e3.
ROUND_OFF = 1e-10
# Residuals of single equations in SI units, forces up to 1e3 N among them.
RESIDUAL = 1e-10
COUNT = 20


def draw(data: ArmData, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    n = len(data.d)
    return rng.uniform(-3, 3, (COUNT, n)), rng.normal(size=(COUNT, n)), 3 * rng.normal(size=(COUNT, n))


@pytest.fixture(scope="module", params=["industrial 6R", "general 3R"])
def arm(request):
    data = industrial_arm() if request.param == "industrial 6R" else random_arm(3, seed=4)
    return data, data.model(), data.pinocchio()


def test_inverse_dynamics(arm):
    data, model, oracle = arm
    q, qd, qdd = draw(data, 1)
    f = model.causal("q", ["tau", "T", "der(T,2)"])
    tau, T, Tdd, status = f(q, qd, qdd)
    assert np.all(status == Status.OK)
    assert {b.kind for b in f.plan.blocks} == {"explicit"}
    work = oracle.createData()
    last = oracle.njoints - 1
    for k in range(COUNT):
        assert relative_error(tau[k], pin.rnea(oracle, work, q[k], qd[k], qdd[k])) < ROUND_OFF
        pin.forwardKinematics(oracle, work, q[k], qd[k], qdd[k])
        assert relative_error(T[k], work.oMi[last].translation) < ROUND_OFF
        classical = pin.getClassicalAcceleration(oracle, work, last, pin.LOCAL_WORLD_ALIGNED).linear
        assert relative_error(Tdd[k], classical) < ROUND_OFF


def test_forward_dynamics(arm):
    data, model, oracle = arm
    q, qd, qdd = draw(data, 2)
    tau = 50 * qdd
    f = model.causal("tau", "der(q,2)")
    assert [s.name for s in f.inputs] == ["q", "der(q)", "tau"]
    assert {b.kind for b in f.plan.blocks} == {"explicit", "linear"}
    found, status = f(q, qd, tau)
    assert np.all(status == Status.OK)
    work = oracle.createData()
    for k in range(COUNT):
        assert relative_error(found[k], pin.aba(oracle, work, q[k], qd[k], tau[k])) < ROUND_OFF


def test_every_equation_as_written_holds():
    data = random_arm(2, seed=5)
    model = data.model()
    rng = np.random.default_rng(3)
    for known, names in (("q", ["q", "der(q)", "der(q,2)"]), ("tau", ["q", "der(q)", "tau"])):
        values = {name: rng.normal(size=2) for name in names}
        assert np.max(np.abs(original_residuals(model, values, known))) < RESIDUAL
