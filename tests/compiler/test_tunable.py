"""Functions of which model parameters are inputs: the same results as functions of models with these values."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import CausalFunction
from gtmodel.results.refusal import ArgumentError

ROUNDING = 1e-13  # of the largest force: the same operations in another order
MASSES = np.array([5.0, 9.1323, 40.0])  # kg
SEED = 46


@pytest.fixture(scope="module")
def robot() -> gt.Model:
    return gt.robots.gantry_tau("l1_tape")


@pytest.fixture(scope="module")
def loaded(robot: gt.Model) -> CausalFunction:
    return robot.causal(known="T", targets="tau", tunable="m_p")


def motion(robot: gt.Model) -> list[np.ndarray]:
    rng = np.random.default_rng(SEED)
    return [robot.home + rng.uniform(-0.1, 0.1, (3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(3, 3))]


def test_the_forces_are_those_of_models_with_these_masses(robot: gt.Model, loaded: CausalFunction) -> None:
    assert [s.name for s in loaded.inputs] == ["T", "der(T)", "der(T,2)", "m_p"] and loaded.inputs[-1].unit == "kg"
    tau, status = loaded(*motion(robot), MASSES)
    assert (status == gt.Status.OK).all()
    for k, m in enumerate(MASSES):
        one, _ = robot.with_(m_p=m).causal(known="T", targets="tau")(*[x[k] for x in motion(robot)])
        np.testing.assert_allclose(tau[k], one, rtol=0, atol=ROUNDING * np.abs(one).max())


def test_newtons_method_with_a_mass() -> None:
    """The pose by Newton's method, the forces after it."""
    six = gt.robots.six_link_gantry_tau()
    f = six.causal(known="T", targets="tau", tunable="m_p")
    assert f.kernels
    rest = [six.home, np.zeros(3), np.zeros(3)]
    tau, status = f(*rest, 50.0)
    one, expected = six.with_(m_p=50.0).causal(known="T", targets="tau")(*rest)
    assert status is expected is gt.Status.OK
    np.testing.assert_allclose(tau, one, rtol=0, atol=1e-9 * np.abs(one).max())


def test_the_derivative_by_a_mass(robot: gt.Model, loaded: CausalFunction) -> None:
    """The forces are affine in the mass of the plate."""
    x = [a[0] for a in motion(robot)]
    J, _ = loaded.jacobian(*x, 9.0)
    low, high = (loaded(*x, m)[0] for m in (9.0, 10.0))
    np.testing.assert_allclose(J[:, -1], high - low, rtol=0, atol=1e-11 * np.abs(high).max())


def test_it_pickles_and_is_kept(robot: gt.Model, loaded: CausalFunction) -> None:
    assert robot.causal(known="T", targets="tau", tunable=["m_p"]) is loaded
    again = pickle.loads(pickle.dumps(loaded))
    np.testing.assert_array_equal(again(*motion(robot), MASSES)[0], loaded(*motion(robot), MASSES)[0])


def test_c_takes_the_mass_and_equals_python(loaded: CausalFunction, tmp_path: Path) -> None:
    made = gt.cgen.generate({"forces": loaded}, tmp_path / "c", name="loaded")
    assert "m_p_kg" in (tmp_path / "c" / "gt_loaded.h").read_text()
    assert gt.cgen.check(made.folder, {"forces": loaded}, points=50).passed


def test_refusals_name_the_argument(robot: gt.Model) -> None:
    for name in ("m_q", "coulomb"):  # not a parameter, and one that kinematics does not depend on
        with pytest.raises(ArgumentError) as error:
            robot.causal(known="T", targets="q", tunable=name)
        assert error.value.argument == "tunable" and name in str(error.value)
