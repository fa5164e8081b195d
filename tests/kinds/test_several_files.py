"""One recording in several files: by keys alone it gives what the file joined by hand gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinds.friction import FrictionLogSection
from gtmodel.kinds.identification.keys import IdentificationLogSection
from gtmodel.kinds.vibration import MeasurementsSection
from gtmodel.measurements import Session
from gtmodel.problem_files.base import Context, InputError
from tests.support.commands import CLONE
from tests.support.recordings import write_synthetic_emps

STEP = 0.004
T = STEP * np.arange(2000)
LATE = 2.5  # s: the second clock began later
POSITION, EFFORT = {"column": "q", "unit": "rad"}, {"column": "f", "unit": "N"}


def motion(t: np.ndarray) -> np.ndarray:
    return np.sin(2 * t + 0.3 * t**2)


def effort(t: np.ndarray) -> np.ndarray:
    return 30 * np.cos(3 * t)


def written(path: Path, head: str, *columns: np.ndarray) -> None:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=head, comments="", fmt="%.17g")


def read(folder: Path, files: list[str] | None = None, **keys: Any) -> tuple[tuple[Session, ...], Context]:
    given: dict[str, Any] = {"time": {"column": "t"}, "position": POSITION, "effort": EFFORT} | keys
    section = IdentificationLogSection.model_validate(given | ({} if files is None else {"files": files}))
    signals = {"q": section.position.signal("log.position", "rad"), "tau": section.effort.signal("log.effort", "N")}
    context = Context(folder=folder)
    return section.sessions(signals, context, called={"position": "q", "effort": "tau"}), context


IN_TWO: dict[str, Any] = {"position": POSITION | {"file": "positions.csv"}, "effort": EFFORT | {"file": "currents.csv"}}


def test_two_files_with_common_rows_are_the_joined_file(tmp_path: Path) -> None:
    written(tmp_path / "whole.csv", "t,q,f", T, motion(T), effort(T))
    written(tmp_path / "positions.csv", "t,q", T, motion(T))
    written(tmp_path / "currents.csv", "t,f", T, effort(T))
    (whole,), _ = read(tmp_path, ["whole.csv"])
    (joined,), context = read(tmp_path, **IN_TWO)
    assert np.array_equal(joined.trajectory.time, whole.trajectory.time) and joined.sample_time == whole.sample_time
    assert np.array_equal(joined.trajectory["q"], whole.trajectory["q"])
    np.testing.assert_allclose(joined.trajectory["tau"], whole.trajectory["tau"], rtol=1e-13)
    assert any("8 s" in note or "7.996 s" in note for note in context.notes)


def test_other_rates_are_interpolated_at_the_rows_of_the_first_signal(tmp_path: Path) -> None:
    fast = 0.3 + 0.00099 * np.arange(6000)
    written(tmp_path / "positions.csv", "t,q", T, motion(T))
    written(tmp_path / "currents.csv", "stamp_ms,f", 1e3 * fast, effort(fast))
    in_two: dict[str, Any] = IN_TWO | {
        "effort": EFFORT | {"file": "currents.csv", "time": {"column": "stamp_ms", "unit": "ms"}},
        "files": ["positions.csv", "currents.csv"],
    }
    (session,), _ = read(tmp_path, **in_two)
    t = session.trajectory.time
    rows = (fast[0] <= T) & (fast[-1] >= T)
    assert np.array_equal(t, T[rows]) and np.array_equal(session.trajectory["q"], motion(T)[rows])
    assert session.trajectory["tau"] == pytest.approx(effort(t), abs=1e-8)
    (even,), _ = read(tmp_path, **in_two, resample={"sample_time_s": 0.002})
    assert even.sample_time == 0.002 and even.trajectory["q"] == pytest.approx(motion(even.trajectory.time), abs=1e-6)


def apart(folder: Path, **keys: Any) -> tuple[tuple[Session, ...], Context]:
    rng = np.random.default_rng(3)  # synthetic: seed 3
    clock = 1000.0 + 0.005 * np.arange(1500)
    written(folder / "positions.csv", "t,q", T, motion(T) + 1e-4 * rng.normal(size=len(T)))
    seen = motion(clock - 1000.0 + LATE) + 1e-4 * rng.normal(size=len(clock))
    written(folder / "currents.csv", "t,f,q2", clock, effort(clock - 1000.0 + LATE), seen)
    return read(folder, **IN_TWO, **keys)


CURVES = {"copy": {"column": "q2", "unit": "rad", "file": "currents.csv"}}


def test_clocks_of_other_origins_are_aligned_by_a_common_curve(tmp_path: Path) -> None:
    (session,), context = apart(tmp_path, curves=CURVES, align=[{"reference": "position", "other": "copy"}])
    t = session.trajectory.time
    assert session.trajectory.names == ("q", "tau") and t[0] == pytest.approx(LATE, abs=STEP)
    assert session.trajectory["tau"] == pytest.approx(effort(t), abs=0.05)
    (note,) = [n for n in context.notes if "explains" in n]
    assert "currents.csv" in note and "-997.5" in note and "ppm" in note and "100 %" in note


@pytest.mark.parametrize(
    ("keys", "key", "said"),
    [
        ({}, "log", "[[log.align]]"),
        ({"align": [{"reference": "position", "other": "copy"}]}, "log.align[0].other", "no signal 'copy'"),
        ({"curves": CURVES, "align": [{"reference": "copy", "other": "effort"}]}, "log.align[0].other", "'tau'"),
        ({"curves": CURVES, "align": [{"reference": "position", "other": "copy", "offset_range_s": [2.0, 1.0]}]},
         "log.align[0].offset_range_s", "lower bound"),
        ({"curves": {"q": POSITION | {"file": "currents.csv", "column": "q2"}}}, "log", "rename the curve"),
        ({"session": "run"}, "log", "own clocks"),
        ({"files": ["positions.csv"]}, "log", "0 for currents.csv"),
        ({"resample": {"longest_gap_s": 1e-6}, "curves": CURVES,
          "align": [{"reference": "position", "other": "copy"}]}, "log.resample.longest_gap_s", "longest gap"),
    ],
)  # fmt: skip
def test_one_sentence_for_each_wrong_case(tmp_path: Path, keys: dict[str, Any], key: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        apart(tmp_path, **keys)
    assert caught.value.key == key and said in str(caught.value), str(caught.value)


def test_an_uneven_reference_needs_resampling(tmp_path: Path) -> None:
    written(tmp_path / "positions.csv", "t,q", np.delete(T, 70), np.delete(motion(T), 70))
    written(tmp_path / "currents.csv", "t,f", T, effort(T))
    with pytest.raises(InputError, match="missing"):
        read(tmp_path, **IN_TWO)
    (session,), _ = read(tmp_path, **IN_TWO, resample={"sample_time_s": STEP})
    assert session.trajectory["q"] == pytest.approx(motion(T), abs=1e-5)


def test_patterns_pair_the_files_of_several_recordings(tmp_path: Path) -> None:
    names = list[str]()
    for run, size in (("a", 500), ("b", 700)):
        t = T[:size]
        for signal, values in (("q", motion(t)), ("f", effort(t))):
            names.append(f"{run}_{signal}.csv")
            written(tmp_path / names[-1], f"t,{signal}", t, values)
    keys: dict[str, Any] = {"position": POSITION | {"file": "*_q.csv"}, "effort": EFFORT | {"file": "*_f.csv"}}
    sessions, _ = read(tmp_path, names, **keys)
    assert [len(s.trajectory) for s in sessions] == [500, 700]
    assert sessions[1].trajectory["tau"] == pytest.approx(effort(T[:700]), rel=1e-12)
    with pytest.raises(InputError, match=r"2 for \*_q.csv, 1 for \*_f.csv"):
        read(tmp_path, names[:3], **keys)


def test_two_clocks_in_one_file_and_the_files_of_a_pose(tmp_path: Path) -> None:
    from scipy.io import savemat

    slow = np.arange(0.0, 7.9, 0.01)
    savemat(tmp_path / "log.mat", {"fast": T, "q": motion(T), "slow": slow, "f": effort(slow)})
    section = FrictionLogSection.model_validate(
        {
            "time": {"column": "fast"},
            "position_m": {"column": "q", "unit": "m"},
            "force_N": EFFORT | {"time": {"column": "slow"}},
        }
    )
    signals = {"q": section.position_m.signal("log.position_m"), "force": section.force_N.signal("log.force_N")}
    (session,) = section.read(["log.mat"], signals, Context(folder=tmp_path), "pose[0].files", table="log")
    assert session.trajectory["force"] == pytest.approx(effort(session.trajectory.time), abs=1e-4)


def test_a_gap_in_one_file_splits_the_recording(tmp_path: Path) -> None:
    kept = (T < 3.0) | (T > 3.5)
    written(tmp_path / "positions.csv", "t,q", T, motion(T))
    written(tmp_path / "currents.csv", "t,f", T[kept], effort(T[kept]))
    sessions, _ = read(tmp_path, **IN_TWO)
    assert [len(s.trajectory) for s in sessions] == [np.sum(T < 3.0), np.sum(T > 3.5)]
    assert all(s.sample_time == pytest.approx(STEP) for s in sessions)


def test_records_of_kind_vibration(tmp_path: Path) -> None:
    written(tmp_path / "positions.csv", "t,q", T, motion(T))
    written(tmp_path / "forces.csv", "t_ms,f", 1e3 * T[100:], effort(T[100:]))
    force = {"column": "f", "unit": "N", "file": "forces.csv", "time": {"column": "t_ms", "unit": "ms"}}
    section = MeasurementsSection.model_validate(
        {"time": {"column": "t"}, "position_m": {"column": "q", "unit": "m", "file": "positions.csv"}, "force_N": force}
    )
    (record,) = section.records("subspace", Context(folder=tmp_path))
    assert record.y[:, 0] == pytest.approx(motion(T[100:])) and record.u[:, 0] == pytest.approx(effort(T[100:]))


def test_a_shipped_problem_with_its_log_in_two_files_has_the_same_result(tmp_path: Path) -> None:
    from scipy.io import loadmat, savemat

    write_synthetic_emps(tmp_path / "log.mat")
    content = {k: v for k, v in loadmat(tmp_path / "log.mat").items() if not k.startswith("__")}
    savemat(tmp_path / "q.mat", {k: content[k] for k in ("t", "qm", "qg")})
    savemat(tmp_path / "vir.mat", {k: content[k] for k in ("t", "vir")})
    whole, parts = (
        gt.load(CLONE / "problems" / "emps.toml", *settings)()
        for settings in (
            [f"log.files=['{tmp_path / 'log.mat'}']"],
            [f"log.files=['{tmp_path / 'q.mat'}', '{tmp_path / 'vir.mat'}']", "log.effort.file='vir.mat'",
             "log.position.file='q.mat'", "closed_loop.inputs.qg.file='q.mat'"],
        )
    )  # fmt: skip
    assert parts.values["parameters"] == pytest.approx(whole.values["parameters"], rel=1e-9)
    assert any("as if their times had one origin" in note for note in parts.notes)
