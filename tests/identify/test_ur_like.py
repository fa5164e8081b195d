"""A UR-like arm from its URDF and motor currents, problems/identify_ur_like.toml: pinocchio computed the torques."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel import der
from gtmodel.identify import BaseRegressor, Fitting, identify, rows_of, with_offsets
from gtmodel.identify.base_parameters import parameters_of
from gtmodel.identify.gains import fit_with_gains, with_gains, with_payloads
from gtmodel.measurements import Column, Corrections, Session, Signal, read_signals, session_of
from gtmodel.results import ArgumentError
from tests.robots.arm_oracle import Pinocchio
from tests.support import ur_like
from tests.support.commands import Commands
from tests.support.ur_like import COULOMB, GAIN, OFFSET, ROTOR, URDF, VISCOUS, plant

pin = pytest.importorskip("pinocchio", reason="pinocchio, the oracle of serial arms, is not installed")
PROBLEM = ur_like.PROBLEMS / "identify_ur_like.toml"
FREE = ["viscous", "coulomb", "rotor_inertia"]
AGREEMENT = 1e-10
CHANCE = 1e-3  # of a false alarm, over all parameters of a fit
# of pinocchio's ten numbers of a link, m mc Ixx Ixy Iyy Ixz Iyz Izz, ours J, mc, m
ORDER = [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]


def bodies() -> dict[str, float]:
    """The true inertial parameters, by our names, from pinocchio."""
    values: dict[str, float] = {}
    for k, inertia in enumerate(list(plant().inertias)[1:]):
        ten = inertia.toDynamicParameters()[ORDER]
        names = [*(f"J[{k},{i}]" for i in range(6)), *(f"mc[{k},{i}]" for i in range(3)), f"m[{k}]"]
        values |= dict(zip(names, ten.tolist(), strict=True))
    return values


def truth(base: BaseRegressor) -> dict[str, float]:
    """True base parameters, friction, gains and offsets by name."""
    arrays = {"viscous": VISCOUS, "coulomb": COULOMB, "rotor_inertia": ROTOR, "tau.scale": GAIN, "tau.offset": OFFSET}
    named = {f"{name}[{k}]": float(x) for name, array in arrays.items() for k, x in enumerate(array)}
    return base.numbers_of(parameters_of(gt.robots.from_urdf(URDF)) | bodies() | named) | named


@pytest.fixture(scope="module")
def solved():
    return gt.load(PROBLEM)()


@pytest.fixture(scope="module")
def base() -> BaseRegressor:
    return BaseRegressor(gt.robots.from_urdf(URDF, smoothing="sign"), FREE)


@pytest.mark.parametrize("name", ur_like.RECORDINGS)
def test_the_files_are_what_the_module_writes(name: str) -> None:
    text, shipped = ur_like.text(name), ur_like.file(name).read_text()
    assert "synthetic: seed 43, noise 0.04 A" in shipped.splitlines()[0] == text.splitlines()[0]
    assert shipped.splitlines()[1] == text.splitlines()[1]
    numbers = (np.loadtxt(t.splitlines(), delimiter=",", skiprows=2) for t in (text, shipped))
    np.testing.assert_allclose(*numbers, rtol=0, atol=1.1e-3)  # the last digit of a current


def test_it_is_solved_and_every_check_passes(solved) -> None:
    assert solved.status.ok
    assert all(check.passed for check in solved.checks.values()), solved.checks
    assert "seed 43" in solved.synthetic and solved.title == "UR-like arm from motor currents"
    assert len(solved.held_out_rms) == 6
    assert {"residuals", "held_out", "efforts", "friction"} <= set(solved.figures)


def test_true_values_are_within_the_intervals(solved, base) -> None:
    true, e = truth(base), solved.estimate
    assert len(e.names) == 36 + 12 + 4 + 6 + 6 and set(e.names) <= set(true)
    off = np.array([abs(e.value(n) - true[n]) / s for n, s in zip(e.names, e.std, strict=True)])
    assert off.max() < scipy.stats.t.ppf(1 - CHANCE / 2 / len(off), e.degrees_of_freedom)
    hits = sum(low <= true[n] <= high for n in e.names for low, high in [e.interval(n)])
    assert hits >= scipy.stats.binom.ppf(CHANCE, len(off), 0.95)


def test_gains_are_in_the_table_with_their_intervals(solved) -> None:
    labels = [row.label for row in solved.rows]
    at = labels.index("tau.scale[2]")
    assert labels[at + 1] == "  95 %" and "1.07" in str(solved.rows[at + 1].value)
    assert solved.corrections["tau.scale[2]"] == pytest.approx(GAIN[2], abs=0.01)
    assert "tau.scale[2]" in solved.files["parameters.toml"]


def test_words_say_what_is_identifiable(solved, base) -> None:
    """Each parameter is in one of three sentences; by hand: the first link only turns about a vertical axis."""
    words = dict(note.split(": ", 1) for note in base.notes[1:])
    assert words["without any effect on the efforts"] == "J[0,0..4], mc[0,0..2], m[0], mc[1,2], m[1]"
    assert words["determined alone"].startswith("viscous[0..5], coulomb[0..5], rotor_inertia[2..5], J[1,1]")
    assert "rotor_inertia[0..1], J[0,5]" in next(v for k, v in words.items() if k.startswith("only in combinations"))
    assert set(base.notes) <= set(solved.notes)
    zeros = [note for note in solved.notes if "distinguished from zero" in note]
    assert len(zeros) == 1 and "mc[1,1] (" in zeros[0]


def test_base_parameters_predict_as_pinocchios_regressor(solved, base) -> None:
    """True efforts of a motion in no recording, from pinocchio's regressor and the true bodies."""
    model = plant()
    data = model.createData()
    q, v, a = np.random.default_rng(5).uniform(-1, 1, (3, 20, 6))
    ten = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
    exact = np.array([pin.computeJointTorqueRegressor(model, data, *row) @ ten for row in zip(q, v, a, strict=True)])
    exact += ROTOR * a + VISCOUS * v + COULOMB * np.sign(v)
    true, Y = truth(base), base(q, v, a).Y
    np.testing.assert_allclose(Y @ [true[n] for n in base.names], exact, atol=AGREEMENT * np.abs(exact).max())
    e = solved.estimate
    places = [e.names.index(n) for n in base.names]
    spread = np.sqrt(np.einsum("nmi,ij,nmj->nm", Y, e.covariance[np.ix_(places, places)], Y))
    off = np.abs(Y @ e.values[places] - exact) / spread
    assert off.max() < scipy.stats.t.ppf(1 - CHANCE / 2 / off.size, e.degrees_of_freedom)


def test_bodies_are_physical_in_pinocchio_too(solved, tmp_path) -> None:
    (tmp_path / "identified.urdf").write_text(solved.files["identified.urdf"])
    model = pin.buildModelFromUrdf(str(tmp_path / "identified.urdf"))
    for inertia in list(model.inertias)[1:]:
        assert np.linalg.eigvalsh(inertia.toPseudoInertia().toMatrix())[0] > 0


def test_where_nothing_is_measured_the_urdf_stays(solved, base) -> None:
    """Rotors 0 and 1 stand only in sums with links; the mass of the first link has no effect."""
    arm = gt.robots.from_urdf(URDF)
    assert solved.masses[0] == pytest.approx(arm.m[0], rel=0.05)
    assert any(note.startswith("where the motion determines nothing") for note in solved.notes)
    chosen = next(note for note in solved.notes if note.startswith("determined only in a sum"))
    assert "rotor_inertia[0] = " in chosen and "rotor_inertia[1] = " in chosen


def test_the_result_is_a_robot_of_other_problems(solved, tmp_path) -> None:
    """identified.toml in a problem file: efforts of the held-out recording, which no fit has seen; and a motion."""
    for name in ("identified.urdf", "identified.toml"):
        (tmp_path / name).write_text(solved.files[name])
    found = gt.load_robot(tmp_path / "identified.toml")
    assert found.rotor_inertia[5] == pytest.approx(ROTOR[5], rel=0.1)
    _, q, v, a = ur_like.motion("held_out")
    rows = slice(200, 1400, 50)
    smooth = COULOMB * (np.tanh(v / 0.1) - np.sign(v))  # a motion needs a smooth friction law
    tau, status = found.causal("q", "tau")(q[rows], v[rows], a[rows])
    assert not np.any(status)
    exact = (ur_like.torques("held_out") + smooth)[rows]
    assert np.all(np.sqrt(np.mean((tau - exact) ** 2, axis=0)) < 0.02 * np.sqrt(np.mean(exact**2, axis=0)))

    class Motion(gt.Optimization):
        final_time = gt.free(1.0, min=0.1, unit="s")
        effort = gt.parameter(found.effort_limits, unit="N.m")
        arm = gt.part(gt.load_robot(tmp_path / "identified.toml", velocity_scale=0.5))

        def objective(self):
            return self.final_time + gt.integral(sum((self.arm.tau[k] / self.effort[k]) ** 2 for k in range(6)))

        def constraints(self):
            for k in range(6):
                yield gt.between(-found.effort_limits[k], self.arm.tau[k], found.effort_limits[k])
                for time, pose in ((self.start_time, ur_like.CENTRE), (self.final_time, ur_like.CENTRE + 0.4)):
                    yield self.arm.q[k].at(time) == pose[k]
                    yield der(self.arm.q[k]).at(time) == 0

    motion = gt.solve(Motion(), mesh=gt.Mesh(elements=8), throw=False)
    assert motion.status.ok


def prepared_rows(base: BaseRegressor, draw=None):
    """Rows of the empty and the loaded recording with the payload's efforts, read without the problem file."""
    columns = lambda name: tuple(f"{name}_{k}" for k in range(6))  # noqa: E731
    factor = tuple(ur_like.GEAR * ur_like.CONSTANT)
    signals = {"q": Signal(columns("actual_q"), "rad"),
               "tau": Signal(columns("actual_current"), "A", scale=factor, quantity_unit="N.m")}  # fmt: skip
    files = [ur_like.file(name) for name in ("empty", "loaded")]
    sessions = Corrections(signals, read_signals(files, signals, time=Column("timestamp", "s"))).apply()
    arm = gt.robots.from_urdf(URDF, smoothing="sign")
    rows = rows_of(sessions, base)
    return with_payloads(rows, arm, base, [0.0, ur_like.LOAD], ur_like.LOAD_AT - np.asarray(arm.tool_xyz))


def test_payloads_are_pinocchios(base) -> None:
    """The efforts of the payload, divided by the filter's gain of 1 at rest: at a still row they are gravity alone."""
    arm = gt.robots.from_urdf(URDF, smoothing="sign")
    rng = np.random.default_rng(2)
    q, v, a = rng.uniform(-1, 1, (3, 5, 6))
    rows = prepared_rows(base)
    some = replace(
        rows, Y=base(q, v, a).Y, y0=np.zeros((5, 6)), effort=np.zeros((5, 6)), time=np.arange(5.0), starts=(0, 2)
    )
    loaded = with_payloads(some, arm, base, [0.0, 2.5], ur_like.LOAD_AT - np.asarray(arm.tool_xyz)).y0
    assert not np.any(loaded[:2])
    empty, full = plant(), plant(2.5)
    for k in range(2, 5):
        by_payload = [pin.rnea(m, m.createData(), q[k], v[k], a[k]) for m in (empty, full)]
        np.testing.assert_allclose(loaded[k], by_payload[1] - by_payload[0], atol=1e-9)


def test_the_optimum_is_that_of_a_nonlinear_fit(base) -> None:
    """Parameters and gains by scipy, without our linear rows; the covariance is that of its Jacobian."""
    rows = prepared_rows(base)
    names = [n for n in base.names if n in rows.names]
    p, m = len(names), 6
    noise = np.full(m, 0.12)

    def prepared(rows, point):
        return with_offsets(rows if point is None else with_gains(rows, "tau", *point), "tau", per_session=False)

    found, _ = fit_with_gains(rows, prepared, lambda r: identify(r, nonnegative=False, noise=noise, test=[]))

    def residual(x: np.ndarray) -> np.ndarray:
        modelled = (rows.Y @ x[:p] + rows.y0) / x[p : p + m] + x[p + m :]
        return ((rows.effort - modelled) / noise).ravel()

    start = np.concatenate([rows.nominal, np.ones(m), np.zeros(m)])
    other = scipy.optimize.least_squares(residual, start, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-12)
    std = np.sqrt(np.diag(np.linalg.inv(other.jac.T @ other.jac)))
    np.testing.assert_allclose((found.estimate.values - other.x) / std, 0.0, atol=1e-4)
    np.testing.assert_allclose(found.estimate.std, std, rtol=1e-4)


@pytest.mark.parametrize(
    ("setting", "key", "sentence"),
    [
        ("payloads_kg=[0.0, 0.0]", "log", "cannot be distinguished from masses"),
        ("payloads_kg=[4.0]", "payloads_kg", "has 1 masses; expected 2"),
        ('log.position.delay_s="estimate"', "log", "an estimate of 'q' cannot be combined"),
        ("payload_centre_m=[0.0, 0.0]", "payload_centre_m", "3"),
    ],
)  # fmt: skip
def test_what_gains_need_is_said(capsys: pytest.CaptureFixture[str], setting: str, key: str, sentence: str) -> None:
    done = Commands(capsys)("solve", PROBLEM, "--set", setting)
    assert done.code == 2
    assert f"{key}: " in done.err and sentence in done.err


def test_the_friction_of_a_file_is_no_measure_of_gains(capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["payloads_kg=[0.0, 0.0]", 'free=["viscous", "rotor_inertia"]', f"parameters.coulomb={COULOMB.tolist()}"]
    done = Commands(capsys)("solve", PROBLEM, *(word for s in settings for word in ("--set", s)))
    assert done.code == 2 and "log: " in done.err and "cannot be distinguished from masses" in done.err


def test_payloads_are_for_arms() -> None:
    with pytest.raises(ArgumentError) as caught:
        gt.identify.study(Slide(), slid(1.0), ["m", "d"], fitting=Fitting(payloads=[1.0]))
    assert caught.value.argument == "fitting.payloads"


def test_wrong_gains_of_the_data_sheet_are_contradicted_by_the_payload() -> None:
    """Up to 8 % off: a check fails and names them. The true ones pass."""
    wrong = gt.load(PROBLEM, "log.effort.scale=1.0")()
    assert [n for n, check in wrong.checks.items() if not check.passed] == ["nothing_left_out"]
    assert any("tau.scale[5]" in note and "estimate the scale" in note for note in wrong.notes)
    right = gt.load(PROBLEM, f"log.effort.scale={GAIN.tolist()}")()
    assert all(check.passed for check in right.checks.values()), right.checks
    assert "nothing_left_out" in right.checks


def test_a_held_out_recording_may_have_a_payload(solved) -> None:
    """The fit of the empty recording and the gains found, judged by the loaded one; without its payload it fails."""
    gains = [solved.corrections[f"tau.scale[{k}]"] for k in range(6)]
    files = [f'log.files=["{ur_like.file("empty")}"]', f'log.held_out=["{ur_like.file("loaded")}"]']
    settings = [*files, f"log.effort.scale={gains}"]
    errors = [gt.load(PROBLEM, *settings, f"payloads_kg={p}")().held_out_rms for p in ([0.0, ur_like.LOAD], [0.0])]
    assert np.all(errors[0] < 2.0 * solved.noise)
    assert np.all(errors[1][1:] > 5.0 * errors[0][1:])


def test_a_payload_on_the_axis_of_a_joint_leaves_its_gain_open(base) -> None:
    """On the axis of the flange a mass has no effect on its motor: the interval of its gain is far wider."""
    rows = prepared_rows(base)
    arm = gt.robots.from_urdf(URDF, smoothing="sign")
    offaxis, onaxis = (np.array([x, 0.0, 0.04]) for x in (0.1, 0.0))
    exact = truth(base)
    spread = []
    for centre in (offaxis, onaxis):
        loaded = with_payloads(replace(rows, y0=np.zeros_like(rows.y0)), arm, base, [0.0, ur_like.LOAD], centre)
        point = (np.array([exact[n] for n in base.names]), np.ones(6))
        linear = with_gains(loaded, "tau", *point)
        spread.append(identify(linear, nonnegative=False, noise=np.full(6, 0.12), test=[]).estimate.std[-1])
    assert spread[1] > 3 * spread[0]


class Slide(gt.Model):
    """A cart with friction and a known weight."""

    m, d, w = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(20.0, unit="N")
    q, tau = gt.variable(unit="m"), gt.variable(unit="N")

    def equations(self):
        yield self.tau == self.m * der(self.q, 2) + self.d * der(self.q) + self.w


def slid(gain: float) -> Session:
    time = 0.004 * np.arange(3000)
    q = gt.identify.multisine(time, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    log = gt.identify.LogSimulator(Slide(), q).draw(1, gt.identify.Sensors(effort_noise=0.2))
    return session_of(gt.Trajectory(time, {"q": log["q"], "tau": log["tau"] / gain}, {"q": "m", "tau": "N"}))


def test_a_known_weight_determines_a_gain_without_payload() -> None:
    signals = {"q": Signal("q", "m"), "tau": Signal("tau", "N", scale="estimate", per_session=())}
    s = gt.identify.study(Slide(), slid(1.1), ["m", "d"], signals=signals)
    for name, true in (("m", 2.0), ("d", 5.0), ("tau.scale", 1.1)):
        low, high = s.intervals[name]
        assert low < true < high and high - low < 0.1 * true, name
    with pytest.raises(ArgumentError, match="cannot be distinguished from masses") as caught:
        gt.identify.study(Slide(), slid(1.1), ["m", "d", "w"], signals=signals)
    assert caught.value.argument == "log"


def test_currents_need_a_data_sheet() -> None:
    currents = {"q": Signal("q", "m"), "tau": Signal("tau", "A", scale="estimate", quantity_unit="N", per_session=())}
    with pytest.raises(ArgumentError, match="relative to the data sheet") as caught:
        gt.identify.study(Slide(), slid(1.0), ["m", "d"], signals=currents)
    assert caught.value.argument == "log"


def test_rotor_inertias_are_pinocchios_armature() -> None:
    q, v, a = np.random.default_rng(8).uniform(-2, 2, (3, 5, 6))
    arm = gt.robots.from_urdf(URDF, rotor_inertia=ROTOR)
    oracle = Pinocchio(URDF, "flange")
    oracle.model.armature = ROTOR
    tau, status = arm.causal("q", "tau")(q, v, a)
    assert not np.any(status)
    exact = np.array([oracle.efforts(*row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(tau, exact, atol=AGREEMENT * np.abs(exact).max())


def test_rotor_inertias_stay_in_robot_files(tmp_path: Path) -> None:
    import tomli_w

    dh = gt.robots.serial_arm([0.5, 0.4], 0.0, m=[3.0, 2.0], rotor_inertia=[0.3, 0.1])
    urdf = gt.robots.from_urdf(gt.robots.to_urdf(dh), rotor_inertia=[0.3, 0.1])
    (tmp_path / "arm.urdf").write_text(gt.robots.to_urdf(urdf))
    for arm in (dh, urdf):
        (tmp_path / "arm.toml").write_text(tomli_w.dumps(gt.robots.robot_table(arm, "arm.urdf")))
        np.testing.assert_array_equal(gt.load_robot(tmp_path / "arm.toml").rotor_inertia, [0.3, 0.1])


@pytest.mark.proof
def test_intervals_hold_with_gains(base) -> None:
    """200 noises: each of 64 parameters in the exact band of that many, pooled 94 to 96 %."""
    rows, exact = prepared_rows(base), truth(base)
    names = (*rows.names, *(f"tau.{what}[{k}]" for what in ("scale", "offset") for k in range(6)))
    noiseless = (rows.Y @ [exact[n] for n in rows.names] + rows.y0) / GAIN + OFFSET
    rng = np.random.default_rng(43)

    def prepared(rows, point):
        return with_offsets(rows if point is None else with_gains(rows, "tau", *point), "tau", per_session=False)

    hits, runs = np.zeros(len(names)), 200
    for _ in range(runs):
        noisy = replace(rows, effort=noiseless + 0.12 * rng.standard_normal(noiseless.shape))
        e = fit_with_gains(noisy, prepared, lambda r: identify(r, nonnegative=False, confidence="white", test=[]))[
            0
        ].estimate
        hits += [e.interval(n)[0] <= exact[n] <= e.interval(n)[1] for n in names]
    low, high = scipy.stats.binom.ppf([CHANCE / 2 / len(names), 1 - CHANCE / 2 / len(names)], runs, 0.95)
    assert hits.min() >= low and hits.max() <= high
    assert 0.94 <= hits.mean() / runs <= 0.96
