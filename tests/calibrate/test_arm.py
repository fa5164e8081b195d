"""A six-axis arm by tracker positions alone, problems/calibrate_arm.toml: its data, what they determine and not."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cli import main
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.robots import resolve
from gtmodel.problem_files.run import answer, explain
from tests.support import arm_poses

PROBLEM = arm_poses.PROBLEMS / "calibrate_arm.toml"


def solved(*settings: str):
    return answer(load(PROBLEM, list(settings)), Context(folder=arm_poses.PROBLEMS))


@pytest.fixture(scope="module")
def study():
    return solved("sensitivity_step=0")


def test_the_data_are_those_of_the_stated_seed() -> None:
    shipped = np.loadtxt(arm_poses.PROBLEMS / "data" / "arm_synthetic.csv", delimiter=",", skiprows=2)
    made = np.array([line.split(",") for line in arm_poses.text().splitlines()[2:]], float)
    np.testing.assert_allclose(shipped, made, atol=2e-4)  # one digit of the last place


def test_an_arm_from_a_urdf_is_calibrated_and_its_data_are_those_of_the_stated_seed() -> None:
    """Three parallel axes: d of two of them is not determined, and Hayati's angles are free instead."""
    nominal = arm_poses.ur_like()
    shipped = np.loadtxt(arm_poses.PROBLEMS / "data" / "ur_like_poses_synthetic.csv", delimiter=",", skiprows=2)
    q, T = arm_poses.poses(nominal, arm_poses.UR_SEED, arm_poses.UR_RANGES)
    np.testing.assert_allclose(shipped, np.hstack([np.degrees(q), 1e3 * T]), atol=2e-4)
    found = answer(
        load(arm_poses.PROBLEMS / "calibrate_ur_like.toml", ["sensitivity_step=0"]), Context(folder=arm_poses.PROBLEMS)
    )
    assert found.status.ok and all(c.passed for c in found.checks.values()), found.message
    free, true = arm_poses.free(nominal), arm_poses.true_arm(nominal, arm_poses.UR_SEED)
    assert {"beta[1]", "beta[2]"} <= set(free) and "8 parameters cannot be seen" in "; ".join(found.notes)
    e = found.estimate
    assert sorted(n for n in e.names if not n.startswith("T.device")) == sorted(free)
    off = [(e.value(n) - np.asarray(getattr(true, n[:-3]))[int(n[-2])]) / e.std[e.names.index(n)] for n in free]
    assert np.max(np.abs(off)) < 4.0


def test_the_problem_frees_what_can_be_determined(study) -> None:
    """And names the others in one note."""
    model = [n for n in study.estimate.names if not n.startswith("T.device")]
    assert sorted(model) == sorted(arm_poses.free())
    notes = "; ".join(study.notes)
    assert "7 parameters cannot be seen" in notes and "d[1], a[5], alpha[5], d[0]" in notes and "explain" in notes


def test_explain_says_why_the_others_stay() -> None:
    said = explain(load(PROBLEM), Context(folder=arm_poses.PROBLEMS))
    assert "beta[1] is free instead" in said
    assert "d[0] stays fixed: its effect is a combination of the frame's shift along z" in said


def test_true_numbers_are_found(study) -> None:
    assert study.status.ok and all(c.passed for c in study.checks.values()), study.checks
    e, true = study.estimate, arm_poses.true_arm()
    assert len(e.names) == 27 and not e.undetermined
    deviations = []
    for name in arm_poses.free():
        array, index = name[:-1].split("[")
        off = e.value(name) - np.asarray(getattr(true, array))[int(index)]
        deviations.append(off / e.std[e.names.index(name)])
    assert np.max(np.abs(deviations)) < 4.0
    assert 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.6  # they are deviations, not smaller
    places = [e.value(f"T.device.t[{k}]") for k in range(3)]
    np.testing.assert_allclose(places, arm_poses.DEVICE_T, atol=3e-4)
    assert study.synthetic.startswith("seed 2026") and "(synthetic)" in study.title


def test_the_calibrated_arm_is_the_true_one(study, tmp_path) -> None:
    """By its robot file and by its URDF, alone in a folder."""
    for name in ("parameters.toml", "calibrated.urdf"):
        (tmp_path / name).write_text(study.files[name])
    q = np.random.default_rng(1).uniform(-0.8, 0.8, (40, 6))
    toml, urdf = (resolve(name, Context(folder=tmp_path)) for name in ("parameters.toml", "calibrated.urdf"))
    assert isinstance(toml, gt.robots.SerialArm)
    by_toml, true, before = (arm_poses.forward(arm, q)[0] for arm in (toml, arm_poses.true_arm(), arm_poses.nominal()))
    by_urdf, _ = urdf.causal(known="q", targets="T")(q)
    np.testing.assert_allclose(by_urdf, by_toml, atol=1e-12)
    off, was = (np.linalg.norm(T - true, axis=1).max() for T in (by_toml, before))
    assert off < 1e-4 and was > 3e-3  # m


def test_a_urdf_is_calibrated_as_well(study, tmp_path) -> None:
    """Its axes get Denavit-Hartenberg numbers; another choice of frames, the same places."""
    (tmp_path / "arm.urdf").write_text(gt.robots.to_urdf(arm_poses.nominal()))
    other = solved("sensitivity_step=0", f'robot="{tmp_path / "arm.urdf"}"')
    assert other.status.ok and len(other.estimate.names) == 27
    assert other.held_out["mean"] == pytest.approx(study.held_out["mean"], rel=1e-6)


def test_other_robots_have_no_such_numbers() -> None:
    with pytest.raises(InputError, match="variant: 'serial' is for serial arms"):
        answer(
            load(arm_poses.PROBLEMS / "calibrate_hexapod.toml", ['variant="serial"']),
            Context(folder=arm_poses.PROBLEMS),
        )


def test_where_the_target_is_known_the_last_link_is_free() -> None:
    """As many numbers as before: theta and d of the last joint say where the target turns, and a how far out."""
    other = solved("sensitivity_step=0", 'fixed=["tool_xyz"]')
    assert other.status.ok and len(other.estimate.names) == 27
    last = {n for n in other.estimate.names if n.endswith("[5]")}
    assert len(last) == 3 and not any(n.startswith("tool_xyz") for n in other.estimate.names)


def test_an_arm_that_is_not_good_enough_is_marked_and_still_read(tmp_path) -> None:
    """`--write-failed` marks its files in their first line, which no reader of URDF minds."""
    out = tmp_path / "out"
    words = ["--set", "accuracy_mm=0.001", "--set", "sensitivity_step=0"]
    assert main(["solve", str(PROBLEM), "--out", str(out), "--write-failed", *words]) == 1
    text = (out / "calibrated.urdf").read_text()
    assert "NOT TO BE USED" in text.splitlines()[0] and text.startswith("<!-- ")
    assert resolve("calibrated.urdf", Context(folder=out)).structure.tool == "tool"


def test_redundant_numbers_are_named() -> None:
    """All numbers of all links and both frames: 12 of 39 are a matter of choice."""
    every = solved("sensitivity_step=0", 'variant="serial"', 'free=["theta", "d", "a", "alpha", "beta", "tool_xyz"]')
    assert every.status.ok
    shown = "; ".join(str(row) for row in every.rows)
    assert "27 of 39 parameters or combinations are determined" in shown
    for sentence in ("d[1] moves with d[2]", "d[0] moves with T.device.t[2]", "tool_xyz[2] moves with d[5]"):
        assert sentence in shown
