"""Inertias of serial arms: base parameters against pinocchio's regressor, bodies that can exist, files of both."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import eigvalsh
from scipy.optimize import least_squares

import gtmodel as gt
from gtmodel.identify import BaseRegressor, consistent_inertias, pseudo_inertia
from gtmodel.identify.base_parameters import parameters_of
from gtmodel.identify.bodies import MOVED, THINNEST, _ten_of
from gtmodel.inference import negligible, nominal_sizes
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.robots import resolve
from gtmodel.problem_files.run import answer
from gtmodel.results import ArgumentError
from tests.robots.arm_oracle import URDF, Pinocchio

pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of serial arms, is not installed")
AGREEMENT = 1e-10
# of pinocchio's ten numbers of a link, m mc Ixx Ixy Iyy Ixz Iyz Izz, ours J, mc, m
ORDER = [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]
FRICTION = ["viscous", "coulomb"]
NUMBERS = [
    "base_xyz", "base_rpy", "xyz", "rpy", "axis", "tool_xyz", "tool_rpy", "m", "mc", "J", "rotor_inertia",
    "velocity_scale", *FRICTION,
]  # fmt: skip


@pytest.fixture(scope="module")
def arm():
    return gt.robots.from_urdf(URDF / "serial.urdf")


@pytest.fixture(scope="module")
def base(arm):
    return BaseRegressor(arm)


def motion(n: int, count: int, seed: int) -> list[np.ndarray]:
    return list(np.random.default_rng(seed).uniform(-2, 2, (3, count, n)))


def test_base_parameters_are_those_of_pinocchios_regressor(arm, base) -> None:
    """36 of 60 for six revolute axes whose first one is vertical, as of a PUMA 560."""
    oracle = Pinocchio(URDF / "serial.urdf", "flange")
    q, v, a = motion(6, 30, 1)
    pinocchios = []
    for row in zip(q, v, a, strict=True):
        Y = pin.computeJointTorqueRegressor(oracle.model, oracle.data, oracle.configuration(row[0]), *row[1:])
        pinocchios.append(Y.reshape(6, 6, 10)[:, :, ORDER].reshape(6, 60))
    everything = np.array(pinocchios)
    assert base.size == 36 == np.linalg.matrix_rank(everything.reshape(-1, 60), rtol=1e-9)
    Y = base(q, v, a).Y
    np.testing.assert_allclose(Y @ base.matrix, everything, atol=AGREEMENT * np.abs(everything).max())


def test_each_combination_has_its_terms(base) -> None:
    assert list(base.combinations) == list(base.names)
    assert base.combinations["J[3,1] - 0.35 mc[4,1]"] == pytest.approx({"J[3,1]": 1.0, "mc[4,1]": -0.35})
    for name, terms in base.combinations.items():
        assert name.startswith(next(iter(terms)))


def test_numbers_of_a_model_are_its_nominal_ones(arm, base) -> None:
    numbers = base.numbers_of(parameters_of(arm))
    np.testing.assert_array_equal([numbers[n] for n in base.names], base.nominal)


def test_a_wall_mounted_arm_has_more_of_them() -> None:
    """Its first axis feels gravity: two moments more."""
    standing, wall = (gt.robots.from_urdf(URDF / "parallel.urdf", base_rpy=[x, 0.0, 0.0]) for x in (0.0, np.pi / 2))
    assert (BaseRegressor(standing).size, BaseRegressor(wall).size) == (15, 17)


def test_other_robots_have_none() -> None:
    with pytest.raises(gt.ModelError, match="need a serial arm"):
        BaseRegressor(gt.robots.gantry_tau("l1_tape"))


ten = arrays(float, 10, elements=st.floats(-2.0, 2.0))


@settings(max_examples=60, deadline=None)
@given(ten)
def test_bodies_that_can_exist_have_a_positive_pseudo_inertia(numbers) -> None:
    """Three principal moments of which none exceeds the sum of the others, and a positive mass."""
    m, c, second = abs(numbers[0]) + 0.01, numbers[1:4], np.abs(numbers[4:7]) + 1e-3
    I = np.diag(second.sum() - second)
    mc, J = gt.robots.serial.structure.moments([m], [c], [I])
    assert np.linalg.eigvalsh(pseudo_inertia(m, mc[0], J[0]))[0] > 0
    np.testing.assert_allclose(_ten_of(pseudo_inertia(m, mc[0], J[0])), [*J[0], *mc[0], m], atol=1e-12)
    longer = np.diag([*np.diag(I)[:2], 1.01 * (I[0, 0] + I[1, 1])])
    mc, J = gt.robots.serial.structure.moments([m], [c], [longer])
    assert np.linalg.eigvalsh(pseudo_inertia(m, mc[0], J[0]))[0] < 0


@pytest.fixture(scope="module")
def study(arm):
    """A synthetic log of the arm with other bodies and friction, and what is identified."""
    rng = np.random.default_rng(3)
    model = gt.robots.from_urdf(URDF / "serial.urdf", smoothing="sign")
    true = model.with_(m=np.array(arm.m) * rng.uniform(0.8, 1.3, 6), viscous=[30.0, 20, 20, 3, 3, 2],
                       coulomb=[30.0, 30, 20, 8, 5, 3])  # fmt: skip
    log = gt.identify.SyntheticLog(
        duration=20.0, reference="q", centre=[0.0, -0.8, 0.4, 0.0, 0.0, 0.0], half_range=[1.5, 1.0, 1.2, 2.0, 1.5, 2.0],
        tracking="exact", effort_noise=[5.0, 5, 5, 1, 1, 0.5], frequencies=[0.11, 0.3, 0.7, 1.1], seed=4,
    )  # fmt: skip
    fitting = gt.identify.Fitting(inertias="consistent")
    return gt.identify.synthetic_study(model, log, FRICTION, plant=true, fitting=fitting)


def test_inertias_are_identified(study) -> None:
    assert study.status.ok
    assert all(check.passed for check in study.checks.values()), study.checks
    assert len(study.parameters) == 36 + 12 and set(study.base_parameters) == set(study.fit.rows.names)
    assert study.checks["consistent_bodies_move"].value < 3.0


def test_the_bodies_can_exist(study) -> None:
    for m, mc, J in zip(study.masses, study.first_moments, study.inertias, strict=True):
        assert np.linalg.eigvalsh(pseudo_inertia(m, mc, J))[0] > 0


def test_the_urdf_is_the_identified_dynamics_in_pinocchio(study, base, tmp_path) -> None:
    file = tmp_path / "identified.urdf"
    file.write_text(study.files["identified.urdf"])
    oracle = Pinocchio(file, "flange")
    q, v, a = motion(6, 10, 5)
    frictionless = gt.robots.from_urdf(file, viscous=np.zeros(6), coulomb=np.zeros(6))
    tau, status = frictionless.causal(known="q", targets="tau")(q, v, a)
    assert not status.any()
    expected = np.array([oracle.efforts(*row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(tau, expected, atol=AGREEMENT * np.abs(expected).max())
    # and what it predicts differs from the estimate by less than the estimate's own interval
    estimate = np.array([study.parameters[n] for n in base.names])
    Y = base(q, v, a).Y
    places = [study.estimate.names.index(n) for n in base.names]
    spread = np.sqrt(np.einsum("nmi,ij,nmj->nm", Y, study.estimate.covariance[np.ix_(places, places)], Y))
    assert np.all(np.abs(expected - Y @ estimate) < 3.0 * spread)


def test_the_robot_file_is_the_same_arm(study, tmp_path) -> None:
    for name in ("identified.urdf", "identified.toml"):
        (tmp_path / name).write_text(study.files[name])
    arms = [resolve(f"identified.{ending}", Context(folder=tmp_path)) for ending in ("urdf", "toml")]
    assert arms[0].structure == arms[1].structure
    for name in NUMBERS:  # all that its efforts depend on; the test before this one compares them with pinocchio's
        np.testing.assert_allclose(getattr(arms[1], name), getattr(arms[0], name), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(arms[1].viscous, [study.parameters[f"viscous[{k}]"] for k in range(6)], rtol=1e-12)


def test_numbers_of_no_body_are_named() -> None:
    arm = gt.robots.serial_arm(a=[0.5], alpha=0.0, base_rpy=[np.pi / 2, 0.0, 0.0], m=[2.0], c=[[-0.25, 0.0, 0.0]],
                               I=[np.diag([0.01, 0.04, 0.04])])  # fmt: skip
    base = BaseRegressor(arm)
    e = gt.inference.linear_fit(np.eye(3), base.nominal * [1.0, 0.2, 1.0], base.names, sigma=1e-3)
    wrong = consistent_inertias(arm, base, e)
    assert np.abs(wrong.moved).max() > MOVED
    assert "not those of physical bodies" in wrong.notes[0]
    assert least_share(arm, wrong) > THINNEST / 2


def least_share(arm, found) -> float:
    """The smallest eigenvalue of the first body's pseudo-inertia, as a share of the model's body."""
    before, after = (
        pseudo_inertia(float(m[0]), np.asarray(mc)[0], np.asarray(J)[0])
        for m, mc, J in ((arm.m, arm.mc, arm.J), (found.m, found.mc, found.J))
    )
    return float(eigvalsh(after, before)[0])


def of_log_cholesky(theta: np.ndarray) -> np.ndarray:
    """Pseudo-inertia of ten numbers without bounds (Rucker and Wensing 2022), the other way to such bodies."""
    U = np.diag([*np.exp(theta[1:4]), 1.0])
    U[0, 1], U[0, 2], U[1, 2] = theta[4:7]
    U[:3, 3] = theta[7:]
    return np.exp(2 * theta[0]) * U @ U.T


def test_the_optimum_is_that_of_log_cholesky_numbers() -> None:
    arm = gt.robots.serial_arm(a=[0.5], alpha=0.0, base_rpy=[np.pi / 2, 0.0, 0.0], m=[2.0], c=[[-0.25, 0.02, 0.0]],
                               I=[np.diag([0.01, 0.04, 0.04])])  # fmt: skip
    base = BaseRegressor(arm)
    target, sigma = base.nominal * [1.2, 0.9, 1.0], 0.02
    c = consistent_inertias(arm, base, gt.inference.linear_fit(np.eye(3), target, base.names, sigma=sigma))
    R = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(2.0, np.asarray(arm.mc)[0], np.asarray(arm.J)[0])))

    def residual(theta: np.ndarray) -> np.ndarray:
        P = of_log_cholesky(theta)
        return np.concatenate([(base.matrix @ _ten_of(P) - target) / sigma, (R @ P @ R.T - np.eye(4)).ravel()])

    start = np.array([0.35, -2.0, -2.0, -2.0, 0.0, 0.0, 0.0, -0.2, 0.0, 0.0])
    other = least_squares(residual, start, xtol=1e-15, ftol=1e-15, gtol=1e-12)
    expected = _ten_of(of_log_cholesky(other.x))
    np.testing.assert_allclose([*c.J[0], *c.mc[0], c.m[0]], expected, atol=2e-4 * np.abs(expected).max())


def test_links_without_bodies_get_one_and_it_is_said() -> None:
    arm = gt.robots.serial_arm(a=[0.5, 0.4], alpha=0.0, base_rpy=[np.pi / 2, 0.0, 0.0])
    base = BaseRegressor(arm)
    true = arm.with_(m=[3.0, 2.0], J=[[0.1, 0, 0, 0.2, 0, 0.25], [0.05, 0, 0, 0.1, 0, 0.12]])
    values = base.numbers_of(parameters_of(true))
    e = gt.inference.linear_fit(np.eye(base.size), [values[n] for n in base.names], base.names, sigma=1e-4)
    c = consistent_inertias(arm, base, e)
    assert np.abs(c.moved).max() < 0.5
    assert c.notes == ("the model has no inertia for link_1, link_2: assumed a body of 10 cm for each",)


def test_a_dh_arm_writes_a_whole_robot_file(tmp_path) -> None:
    rng = np.random.default_rng(7)
    root = 0.2 * rng.normal(size=(2, 3, 3))
    for convention in ("standard", "modified"):
        arm = gt.robots.serial_arm([0.5, 0.4], [0.3, -0.1], [0.1, 0.2], convention=convention, m=[3.0, 2.0],
                                   c=rng.normal(size=(2, 3)), I=root @ root.transpose(0, 2, 1),
                                   tool_xyz=[0.1, 0, 0], limits=[[-1, 1], [-2, 2]])  # fmt: skip
        import tomli_w

        (tmp_path / "arm.toml").write_text(tomli_w.dumps(gt.robots.robot_table(arm, "")))
        again = resolve("arm.toml", Context(folder=tmp_path))
        q, v, a = motion(2, 3, 8)
        for x, y in zip(*(r.causal(known="q", targets=["tau", "T"])(q, v, a) for r in (arm, again)), strict=True):
            np.testing.assert_allclose(x, y, atol=1e-12)
        np.testing.assert_allclose(again.joint_limits, arm.joint_limits)


PROBLEM = """
kind = "identification"
robot = "parallel.urdf"
free = ["viscous"]
inertias = "consistent"
[synthetic]
reference = "q"
tracking = "exact"
duration_s = 10.0
centre = [0.0, 0.3, 0.5]
half_range = 1.0
frequencies_Hz = [0.2, 0.5, 0.9]
effort_noise = 0.5
parameters = { viscous = [5.0, 4.0, 3.0] }
"""


def test_a_problem_file_asks_for_them(tmp_path: Path) -> None:
    (tmp_path / "parallel.urdf").write_text((URDF / "parallel.urdf").read_text())
    (tmp_path / "arm.toml").write_text(PROBLEM)
    done = answer(load(tmp_path / "arm.toml"), Context(folder=tmp_path))
    assert done.status.ok and {"identified.urdf", "identified.toml"} <= set(done.files)
    names = list(done.values["parameters"])
    assert names[:3] == ["viscous[0]", "viscous[1]", "viscous[2]"] and len(done.values["masses_kg"]) == 3
    for key, value, sentence in (
        ("watch", '["m"]', "watch: cannot be combined with inertias"),
        ("robot", '"l1_tape"', "need a serial arm"),
    ):
        with pytest.raises(gt.problem_files.InputError, match=sentence):
            answer(load(tmp_path / "arm.toml", [f"{key}={value}"]), Context(folder=tmp_path))


@pytest.mark.proof
def test_intervals_of_base_parameters_hold(tmp_path: Path) -> None:
    """200 seeds: each in the exact 99.9 % band of 179 to 198, pooled 94 to 96 %."""
    (tmp_path / "parallel.urdf").write_text((URDF / "parallel.urdf").read_text())
    (tmp_path / "arm.toml").write_text(PROBLEM.replace('"consistent"', '"base"'))
    done = answer(
        load(tmp_path / "arm.toml", ["synthetic.runs=200", "synthetic.processes=0"]), Context(folder=tmp_path)
    )
    hits = done.coverage["hits"].values()
    assert len(hits) == 18 and min(hits) >= 179 and max(hits) <= 198
    assert 0.94 <= done.coverage["pooled"] <= 0.96


MEASURED = """
kind = "identification"
robot = "parallel.urdf"
inertias = "consistent"
[filter]
cutoff_Hz = 5.0
[log]
files = ["log.csv"]
position = { column = "q", unit = "deg" }
effort = { column = "tau", unit = "N.m" }
"""


def test_a_measured_log_in_degrees_gives_them_too(tmp_path: Path) -> None:
    (tmp_path / "parallel.urdf").write_text((URDF / "parallel.urdf").read_text())
    (tmp_path / "arm.toml").write_text(MEASURED)
    plant = gt.robots.from_urdf(URDF / "parallel.urdf")
    time = 0.004 * np.arange(3000)
    q = gt.identify.multisine(time, np.array([0.0, 0.3, 0.5]), np.ones(3), np.array([0.2, 0.5, 0.9]), seed=2)
    log = gt.identify.LogSimulator(plant, q).draw(1, gt.identify.Sensors(effort_noise=0.5))
    columns = np.column_stack([time, np.degrees(log["q"]), log["tau"]])
    header = ",".join(["time", *(f"q[{k}]" for k in range(3)), *(f"tau[{k}]" for k in range(3))])
    np.savetxt(tmp_path / "log.csv", columns, delimiter=",", header=header, comments="", fmt="%.9g")
    done = answer(load(tmp_path / "arm.toml"), Context(folder=tmp_path))
    assert done.status.ok and all(c.passed for c in done.checks.values()), done.checks
    base = BaseRegressor(plant)
    e = done.estimate
    off = [(e.value(n) - true) / s for n, s, true in zip(e.names, e.std, base.nominal, strict=True)]
    assert np.max(np.abs(off)) < 4.0


def test_a_nominal_value_of_rounding_gives_zeros_no_size(study) -> None:
    """A vendor's product of inertia of -2.9e-16: all zero ones of its unit counted with that size, and the motion "did
    not determine" them."""
    rows = study.fit.rows
    zero = rows.names.index(next(n for n in rows.names if n.startswith("J[") and "- " not in n and "+ " not in n))
    plain, rounded = (replace(rows, nominal=np.where(np.arange(len(rows.names)) == zero, size, rows.nominal))
                      for size in (0.0, -2.9e-16))  # fmt: skip
    a, b = (gt.identify.identify(r, nonnegative=False, test=[]).identifiability for r in (plain, rounded))
    assert b.redundant == 0 and b.condition == a.condition


def test_negligible_nominal_values_have_the_size_of_others_of_their_unit() -> None:
    values, units = np.array([1.9, -2.9e-16, 0.05, 0.0, 0.0]), ["kg.m2"] * 4 + ["N"]
    assert negligible(values, units).tolist() == [False, True, False, True, True]
    assert nominal_sizes(values, units).tolist() == [1.9, 0.05, 0.05, 0.05, 0.0]


@pytest.mark.parametrize("case", ["width 0", "width inf", "width nan", "another arm", "other names", "no number"])
def test_bodies_are_not_sought_for_what_does_not_belong_together(case: str) -> None:
    body = {"m": 2.0, "c": [-0.25, 0, 0], "I": np.diag([0.01, 0.04, 0.04])}
    one, two = (
        gt.robots.serial_arm(
            a=[0.5] * n, alpha=[0.0] * n, base_rpy=[np.pi / 2, 0, 0], **{k: [x] * n for k, x in body.items()}
        )
        for n in (1, 2)
    )
    base = BaseRegressor(one)
    e = gt.inference.linear_fit(np.eye(base.size), base.nominal, base.names, sigma=1e-3)
    other = gt.inference.linear_fit(np.eye(1), [1.0], ["x"], sigma=1.0)
    bad = replace(e, values=np.full(base.size, np.nan))
    width = float(case.partition(" ")[2]) if case.startswith("width") else 1.0
    arm, estimate, argument = {
        "another arm": (two, e, "base"), "other names": (one, other, "estimate"), "no number": (one, bad, "estimate"),
    }.get(case, (one, e, "width"))  # fmt: skip
    with pytest.raises(ArgumentError) as caught:
        consistent_inertias(arm, base, estimate, width=width)
    assert caught.value.argument == argument
