"""Oscillators over the pose: one answer in NumPy, CasADi, C and from the file; cost in instructions."""

from __future__ import annotations

import itertools
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from gtmodel.vibration import (
    KernelInputs,
    OscillatorField,
    fit_oscillator_field,
    load_oscillator_field,
    oscillator_text,
    synthetic_field,
)
from tests.bench import callgrind

POSES, POINTS = 60, 5
CYCLE, SHARE = 0.004, 0.01  # s, of it
PER_SECOND = 1e9  # instructions of a controller
ROUNDING = 1e-11  # of logarithms: sums of 60 weights of size 1e2
INPUTS = KernelInputs((0.5, 0.5, 0.5, 1.0), (False, False, False, True))


def truth():
    rng = np.random.default_rng(0)
    poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (6, 4))
    m, c, k = (size * np.exp(0.4 * rng.standard_normal((6, 3))) for size in (200.0, 4000.0, 3e6))
    return synthetic_field(poses, m, c, k, INPUTS, np.array([2.0, 0.8, 2.0, 0.8]), seed=4), (poses, m, c, k)


def samples(n: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (n, 4))


@pytest.fixture(scope="module")
def fields() -> dict[tuple[str, bool], OscillatorField]:
    poses = samples(POSES)
    rng = np.random.default_rng(2)
    values = np.stack(truth()[0].at(poses)) * np.exp(0.133 * rng.standard_normal((3, POSES, 3)))
    return {
        (shape, shared): fit_oscillator_field(poses, *values, shape=shape, shared=shared, calibrate=False, starts=1)[0]
        for shape, shared in itertools.product(("squared_exponential", "matern_5_2"), (True, False))
    }


@pytest.fixture
def field(fields) -> OscillatorField:
    return fields["squared_exponential", True]


def test_a_pose_gives_three_oscillators_and_poses_give_rows(field) -> None:
    poses = samples(5)
    rows = field.at(poses)
    assert [v.shape for v in rows] == [(5, 3)] * 3 and [v.shape for v in field.at(poses[0])] == [(3,)] * 3
    np.testing.assert_allclose(np.stack(field.at(poses[2])), np.stack(rows)[:, 2], rtol=ROUNDING)
    m, c, k = rows
    np.testing.assert_allclose(field.value("fn", poses), np.sqrt(k / m) / (2 * np.pi))
    np.testing.assert_allclose(field.value("zeta", poses), c / 2 / np.sqrt(k * m))


def test_intervals_hold_the_value_and_those_of_a_measurement_are_wider(field) -> None:
    pose = samples(4)
    for name in ("m", "c", "k", "fn", "zeta"):
        inner, outer = (field.prediction_interval(name, pose, of=of) for of in ("field", "measurement"))
        assert inner.shape == (4, 3, 2) and np.all(inner > 0)
        value = field.value(name, pose)
        assert np.all((inner[..., 0] < value) & (value < inner[..., 1]))
        assert np.all(outer[..., 0] < inner[..., 0]) and np.all(outer[..., 1] > inner[..., 1])


@pytest.mark.parametrize("shape", ["squared_exponential", "matern_5_2"])
@pytest.mark.parametrize("shared", [True, False])
def test_casadi_gives_the_same_and_gradients_of_finite_differences(fields, shape, shared) -> None:
    field = fields[shape, shared]
    f = field.casadi_function(std=True)
    pose = ca.MX.sym("pose", 4)
    jacobian = ca.Function("J", [pose], [ca.jacobian(ca.log(ca.vertcat(*f(pose)[:3])), pose)])
    # at a training pose too, where the root of a distance has no slope
    for p in (*samples(3, 5), field.processes["x", "m"].X[7]):
        found = [np.array(v).ravel() for v in f(p)]
        np.testing.assert_allclose(found[:3], field.at(p), rtol=ROUNDING)
        stds = [field._logs(p[None], "field")[1][q, 0] for q in range(3)]
        np.testing.assert_allclose(found[3:], stds, rtol=1e-7)
        h = 1e-5
        numeric = [(np.log(field.at(p + h * e)) - np.log(field.at(p - h * e))).ravel() / (2 * h) for e in np.eye(4)]
        np.testing.assert_allclose(np.array(jacobian(p)), np.array(numeric).T, atol=1e-5)


def counted(field: OscillatorField, folder: Path, name: str) -> tuple[np.ndarray, float]:
    """What the C code computes at some poses (n, 9), and instructions per call."""
    source = folder / f"{name}.c"
    source.write_text(field.c_code(name=name), encoding="utf-8")
    f = field.casadi_function(name=name)
    header = folder / f"{name}.h"
    header.write_text(f"int {name}(const double**, double**, long long int*, double*, int);\n", encoding="utf-8")
    statement = f"""{{
        const double *arg[{f.sz_arg()}] = {{in}};
        double *res[{f.sz_res()}] = {{out, out + 3, out + 6}};
        static double w[{f.sz_w() + 1}];
        static long long int iw[{f.sz_iw() + 1}];
        {name}(arg, res, iw, w, 0);
    }}"""
    call = callgrind.Call(name, statement, samples(POINTS, 6), 9, str(header))
    found = callgrind.count({"field": call}, [source])["field"]
    return found.outputs, found.instructions


@pytest.mark.skipif(callgrind.missing() is not None, reason=callgrind.missing() or "")
def test_c_gives_the_same_within_a_hundredth_of_the_cycle(field, tmp_path) -> None:
    """Nine processes of sixty poses each, all together."""
    found, instructions = counted(field, tmp_path, "oscillators")
    m, c, k = field.at(samples(POINTS, 6))
    np.testing.assert_allclose(found, np.hstack([m, c, k]), rtol=ROUNDING)
    assert instructions < SHARE * CYCLE * PER_SECOND


@pytest.mark.proof
@pytest.mark.skipif(callgrind.missing() is not None, reason=callgrind.missing() or "")
@pytest.mark.parametrize("shape", ["squared_exponential", "matern_5_2"])
def test_shared_lengths_make_the_cycle(fields, tmp_path, shape, capsys) -> None:
    """One exponential for the three processes of a direction; without, a hundredth of the cycle is missed."""
    _, shared = counted(fields[shape, True], tmp_path, "shared")
    _, apart = counted(fields[shape, False], tmp_path, "apart")
    with capsys.disabled():
        print(f"\n{shape}: {shared:.0f} instructions shared, {apart:.0f} apart, of {SHARE * CYCLE * PER_SECOND:.0f}")
    assert shared < SHARE * CYCLE * PER_SECOND < apart


def test_the_same_field_gives_the_same_c(field) -> None:
    assert field.c_code() == field.c_code()


def test_the_file_gives_the_same_bits(field, tmp_path) -> None:
    path = tmp_path / "oscillators.toml"
    path.write_text(oscillator_text(field), encoding="utf-8")
    loaded = load_oscillator_field(path)
    poses = samples(20)
    for name in ("m", "c", "k"):
        assert np.array_equal(loaded.value(name, poses), field.value(name, poses))
        assert np.array_equal(loaded.prediction_interval(name, poses), field.prediction_interval(name, poses))
    assert oscillator_text(loaded) == oscillator_text(field) and loaded.synthetic is None


def test_milling_takes_its_oscillators(field) -> None:
    from gtmodel.milling import Oscillators

    poses = samples(7)
    taken = Oscillators(*field.at(poses))
    assert taken.m.shape == (7, 3) and np.array_equal(taken.k, field.value("k", poses))


def test_a_synthetic_field_says_so_in_its_file(field, tmp_path) -> None:
    marked = OscillatorField(field.processes, "seed 3")
    path = tmp_path / "oscillators.toml"
    path.write_text(oscillator_text(marked), encoding="utf-8")
    assert path.read_text().startswith("# SYNTHETIC: seed 3\n") and load_oscillator_field(path).synthetic == "seed 3"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("format = 1", r"wrong.toml has the format 1; expected 'gtmodel oscillator field 1'"),
        ("format =", r"wrong.toml cannot be read as an oscillator field"),
        ('format = "gtmodel oscillator field 1"', r"wrong.toml lacks the key 'covariance'"),
    ],
)
def test_other_files_are_refused(tmp_path, text, said) -> None:
    (tmp_path / "wrong.toml").write_text(text)
    with pytest.raises(ValueError, match=said):
        load_oscillator_field(tmp_path / "wrong.toml")


def test_held_out_errors_widen_and_missing_directions_are_left_out() -> None:
    poses = samples(30)
    values = np.stack(truth()[0].at(poses)) * np.exp(0.133 * np.random.default_rng(2).standard_normal((3, 30, 3)))
    values[:, 4, 1] = np.nan
    field, errors = fit_oscillator_field(poses, *values, starts=1)
    assert len(field.processes["y", "m"].y) == 29 and len(field.processes["x", "m"].y) == 30
    for key, g in field.processes.items():
        error, std = errors[key]
        assert g.inflation == pytest.approx(max(1.0, float(np.sqrt(np.mean((error / std) ** 2)))))


def test_refusals(field) -> None:
    poses = samples(8)
    good = np.ones((8, 3))
    for call, said in (
        (lambda: fit_oscillator_field(poses[:, :3], good, good, good), r"poses \(8, 3\) and m \(8, 3\) do not fit"),
        (lambda: fit_oscillator_field(poses, good, -good, good), "c is not positive at pose 0"),
        (lambda: field.value("f", poses), "quantity 'f' of an oscillator"),
        (lambda: field.at([0.0, 0.0, 0.0]), r"the pose has the shape \(3,\); expected \(4,\) or \(n, 4\)"),
        (lambda: field.at([np.nan] * 4), "a pose is not finite"),
    ):
        with pytest.raises(ValueError, match=said):
            call()


def test_a_synthetic_field_passes_near_what_is_given_and_is_smooth() -> None:
    made, (poses, m, c, k) = truth()
    np.testing.assert_allclose(np.stack(made.at(poses)), np.stack([m, c, k]), rtol=0.3)
    h = 1e-4
    steps = np.log(np.stack(made.at(poses + h))) - np.log(np.stack(made.at(poses)))
    assert 0 < np.abs(steps).max() < 100 * h
    np.testing.assert_array_equal(np.stack(made.at(poses)), np.stack(truth()[0].at(poses)))


def test_far_from_the_measured_poses_a_field_says_that_it_tells_nothing(field) -> None:
    far = np.add(samples(4), [[2.0, 0, 0, 0], [0, 3.0, 0, 0], [0, 0, 0, 3.0], [9.0, 9.0, 9.0, 0]])
    assert np.all(field.covers(samples(POSES))) and not np.any(field.covers(far))
    assert field.covers(samples(1)[0]) is True and field.covers(far[0]) is False
    # a turn of 360 degrees is the same pose
    assert np.all(field.covers(np.add(samples(5), [0, 0, 0, 2 * np.pi])))


POSE_OF_LEVEL = np.array([0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("level", [95, 0.0, 1.0, -0.95, np.nan])
def test_a_level_is_a_probability(field, level) -> None:
    with pytest.raises(ValueError, match="expected a probability between 0 and 1"):
        field.prediction_interval("m", POSE_OF_LEVEL, level)
    with pytest.raises(ValueError, match="expected a probability between 0 and 1"):
        field.processes["x", "m"].prediction_interval(np.atleast_2d(POSE_OF_LEVEL), level)


def test_an_infinite_measurement_is_refused_and_not_left_out() -> None:
    poses = np.random.default_rng(1).uniform(-0.5, 0.5, (12, 4))
    whole = np.ones((12, 3))
    wrong = np.where(np.arange(12)[:, None] == 4, np.inf, whole)
    with pytest.raises(ValueError, match="c is infinite at pose 4"):
        fit_oscillator_field(poses, whole, wrong, whole, calibrate=False)
