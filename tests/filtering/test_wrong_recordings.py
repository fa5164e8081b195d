"""Recordings of a gyro and references: clean ones raise no alarm, planted faults are found and named.

Sets, seeds and sizes were stated before the tests of data were written: clean, 400 synthetic recordings of the default
size, seeds 20000 to 20399, at most 15 with any failed check or refusal. Planted, 200 of 12 s, seeds 30000 to 30199, the
faults in turn: the gyro's clock 2 s late, one axis of the wrong sign, two axes exchanged, deg/s declared as rad/s; at
least 190 named. The first run of the proofs found 198 of 200, and 16 alarms of 400: thirteen intervals of 95 % that did
not overlap, where chance alone does that in 4 %.
"""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.filtering import AttitudeJudging, AttitudeRecording, SyntheticAttitude, synthetic_attitude
from gtmodel.filtering.attitude.between_references import MOST_GAPS
from gtmodel.results import ArgumentError

CLEAN, MOST_ALARMS = 400, 15
PLANTED, LEAST_FOUND = 200, 190
FAULTS = ("clock", "sign", "exchanged", "unit")
PERIOD = SyntheticAttitude().sample_period
SHIFT = 2.0  # s, of the gyro's clock
TOLD = 0.05  # s; half of the time between two references
WHERE = {"clock": "judging.longest_offset", "sign": "recording", "exchanged": "recording", "unit": "recording"}


def with_fault(seed: int, fault: str) -> tuple[AttitudeRecording, list[str]]:
    """A recording with this fault, and words that its refusal must hold."""
    made = synthetic_attitude(SyntheticAttitude(duration=12.0, seed=seed)).recording
    time, rate, unit = made.gyro.time, made.gyro["rate"].copy(), "1"
    axes, words = np.random.default_rng([seed, 1]).permutation(3), list[str]()
    if fault == "clock":
        time, words = time + SHIFT, ["clocks", "s apart"]
    if fault == "sign":
        rate[:, axes[0]] *= -1
        words = [f"the {'xyz'[axes[0]]} axis", "sign"]
    if fault == "exchanged":
        i, j = sorted(axes[:2])
        rate[:, [i, j]] = rate[:, [j, i]]
        words = [f"axes {'xyz'[i]} and {'xyz'[j]}", "exchanged"]
    if fault == "unit":
        unit, words = "rad/s", ["in deg/s"]
    return AttitudeRecording(gt.Trajectory(time, {"rate": rate}, {"rate": unit}), made.reference), words


def found(seed: int, fault: str) -> bool:
    recording, words = with_fault(seed, fault)
    try:
        gt.filtering.attitude_study(recording, AttitudeJudging(gaps=(0.3,), sample_period=PERIOD))
    except ArgumentError as refused:
        told = re.search(r"([+-][0-9.]+) s apart", refused.message)
        right = fault != "clock" or (told is not None and abs(float(told[1]) + SHIFT) < TOLD)
        return refused.argument == WHERE[fault] and right and all(word in refused.message for word in words)
    return False


def alarmed(seed: int, duration: float = SyntheticAttitude().duration) -> bool:
    judging = AttitudeJudging(gaps=(0.3,), sample_period=PERIOD)
    study = gt.filtering.attitude_study(SyntheticAttitude(seed=seed, duration=duration), judging)
    return not study.status.ok


@pytest.mark.proof
def test_clean_recordings_raise_no_alarm() -> None:
    assert sum(alarmed(20_000 + k) for k in range(CLEAN)) <= MOST_ALARMS


@pytest.mark.proof
def test_planted_faults_are_found_and_named() -> None:
    assert sum(found(30_000 + k, FAULTS[k % len(FAULTS)]) for k in range(PLANTED)) >= LEAST_FOUND


@pytest.mark.parametrize("fault", FAULTS)
def test_some_planted_faults_are_found_and_named(fault: str) -> None:
    """The first three of each, of which none may be missed."""
    first = FAULTS.index(fault)
    assert all(found(30_000 + 4 * k + first, fault) for k in range(3))


def test_a_part_that_does_not_turn_about_an_axis_says_so() -> None:
    """The second half turns about the vertical only; its stamps are right."""
    time, half = np.arange(0.0, 18.0, 0.01), 9.0
    early = np.column_stack([np.sin(3 * time), np.cos(2.3 * time), np.sin(1.7 * time + 1)]) * (time < half)[:, None]
    rate = early + np.outer(np.where(time >= half, np.sin(2 * time), 0.0), [0.0, 0.0, 1.0])
    steps = Rotation.from_rotvec(0.005 * (rate[1:] + rate[:-1]))
    turned = [Rotation.identity()]
    for step in steps:
        turned.append(turned[-1] * step)
    rows = np.arange(0, len(time), 8)
    quaternion = np.array([turned[k].as_quat(scalar_first=True) for k in rows])
    quaternion += np.random.default_rng(1).normal(0, 1e-4, quaternion.shape)
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    recording = AttitudeRecording(
        gt.Trajectory(time, {"rate": rate}, {"rate": "rad/s"}), gt.Trajectory(time[rows], {"quaternion": quaternion})
    )
    with pytest.raises(ArgumentError) as refused:
        gt.filtering.attitude_study(recording, AttitudeJudging(calibrate_until=half, gaps=(0.3,)))
    assert refused.value.argument == "judging.calibrate_until"
    assert "second part" in refused.value.message


def test_many_references_cost_what_they_must_and_thinning_is_said() -> None:
    """Fifty references a second: as many gaps are judged as of fewer, and the truth lies in the intervals."""
    many = SyntheticAttitude(duration=13.0, seed=11, reference_period=0.02, resolution=1e-3)
    study = gt.filtering.attitude_study(many, AttitudeJudging(gaps=(1.0,), sample_period=PERIOD))
    assert any("every" in note and "references" in note for note in study.notes)
    assert 0 < max(study.starts) <= MOST_GAPS and study.checks["true_numbers"].passed


@pytest.mark.parametrize("after", [1, 40, 400])
def test_a_study_that_is_stopped_keeps_what_it_found(after: int) -> None:
    asked = 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > after

    study = gt.filtering.attitude_study(
        SyntheticAttitude(duration=12.0, seed=2), AttitudeJudging(gaps=(0.3,), sample_period=PERIOD), stop=stop
    )
    assert study.status.value == "interrupted" and asked <= after + 2
    assert (study.convention != "") == (after > 1) and str(study)
