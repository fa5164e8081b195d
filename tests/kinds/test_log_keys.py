"""By TOML alone: one log in files of every form gives the same recordings, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from gtmodel.kinds.identification.keys import IdentificationLogSection
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from tests.support.commands import CLONE
from tests.support.recordings import write_synthetic_emps

T = 0.004 * np.arange(50)
Q, F = np.random.default_rng(8).standard_normal((2, 50))  # synthetic: seed 8
TABLE = np.column_stack([T, Q, F])
POSITION, EFFORT = {"column": "q", "unit": "mm"}, {"column": "f", "unit": "N"}
Writer = Callable[[Path], dict[str, Any]]


def text(
    name: str = "log.csv", sign: str = ",", head: str = "t,q,f", point: str = ".", rows: np.ndarray = TABLE
) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        lines = [sign.join(map(repr, row)).replace(".", point) for row in rows.tolist()]
        (folder / name).write_text("\n".join([*([head.replace(",", sign)] if head else []), *lines]) + "\n")

    return write


def matlab(**variables: Any) -> Callable[[Path], None]:
    return lambda folder: savemat(folder / "log.mat", variables)


def parquet(folder: Path) -> None:
    arrow, tables = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    tables.write_table(arrow.table({"t": T, "q": Q, "f": F}), folder / "log.parquet")


LATE = np.vstack([TABLE[:20], TABLE[21:23], TABLE[20:21], TABLE[23:]])
FORMS: dict[str, tuple[Callable[[Path], None], dict[str, Any]]] = {
    "CSV": (text(), {}),
    "semicolons and decimal commas": (text(sign=";", point=","), {"decimal": "comma"}),
    "bars, said so": (text(sign="|"), {"delimiter": "bar"}),
    "no header": (
        text(head=""),
        {"time": {"column": "1"}, "position": POSITION | {"column": "2"}, "effort": EFFORT | {"column": "3"}},
    ),
    "lines above": (text(head="made by,x\n\nt,q,f"), {"header": 3}),
    "late rows": (text(rows=LATE), {"late_rows": "sort"}),
    "empty rows": (text(rows=np.insert(TABLE, 7, np.nan, axis=0)), {"empty_rows": "drop"}),
    "MATLAB": (matlab(t=T, q=Q, f=F), {"files": ["log.mat"]}),
    "a struct": (
        matlab(rec={"t": T[None], "q": Q[None], "f": F[None]}),
        {
            "files": ["log.mat"], "time": {"column": "rec.t"}, "position": POSITION | {"column": "rec.q"},
            "effort": EFFORT | {"column": "rec.f"},
        },
    ),
    "Parquet": (parquet, {"files": ["log.parquet"]}),
}  # fmt: skip


def read(folder: Path, given: dict[str, Any]) -> Any:
    log = {"files": ["log.csv"], "time": {"column": "t"}, "position": POSITION, "effort": EFFORT}
    keys = IdentificationLogSection(**log | given)
    signals = {"q": keys.position.signal("log.position", "m"), "f": keys.effort.signal("log.effort", "N")}
    return keys.sessions(signals, Context(folder=folder))


@pytest.mark.parametrize("form", FORMS)
def test_a_log_of_any_form(tmp_path: Path, form: str) -> None:
    write, given = FORMS[form]
    write(tmp_path)
    (session,) = read(tmp_path, given)
    np.testing.assert_array_equal(session.trajectory.time, T)
    np.testing.assert_array_equal(session.trajectory["q"], Q / 1000)
    np.testing.assert_array_equal(session.trajectory["f"], F)


def test_a_log_without_time(tmp_path: Path) -> None:
    text()(tmp_path)
    (session,) = read(tmp_path, {"time": {"column": ""}, "sample_time_s": 0.002})
    np.testing.assert_array_equal(session.trajectory.time, 0.002 * np.arange(50))
    with pytest.raises(InputError) as caught:
        read(tmp_path, {"time": {"column": ""}})
    assert caught.value.key == "log.sample_time_s"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"delimiter": "semicolon"}, "log.csv line 1"),
        ({"stream": "/imu"}, "there is no stream '/imu'"),
        ({"header": 400}, "no line 400"),
        ({"decimal": "comma"}, "log.csv"),
    ],
)
def test_what_does_not_fit_is_said_at_the_section(tmp_path: Path, given: dict[str, Any], said: str) -> None:
    text()(tmp_path)
    with pytest.raises(InputError, match=said) as caught:
        read(tmp_path, given)
    assert caught.value.key == "log"


def test_a_recording_with_two_clocks(tmp_path: Path) -> None:
    slow = np.arange(0.0, 0.2, 0.013)
    savemat(tmp_path / "log.mat", {"fast": T, "q": Q, "slow": slow, "f": np.cos(slow)})
    keys = RecordingFiles(files=["log.mat"])
    fast = RecordedSignalSection.model_validate(POSITION | {"time": {"column": "fast"}})
    other = RecordedSignalSection.model_validate(EFFORT | {"time": {"column": "slow"}})
    recording = keys.recording({"q": fast, "f": other}, Context(folder=tmp_path))
    assert {clock: len(trajectory) for clock, trajectory in recording.items()} == {"fast": 50, "slow": len(slow)}
    np.testing.assert_array_equal(recording["slow"]["f"], np.cos(slow))


def test_a_drive_whose_log_is_a_struct_of_rows_gives_the_same_result(tmp_path: Path) -> None:
    """The shipped problem, its log once in vectors and once in a struct, by keys alone."""
    from gtmodel.problem_files.load import load
    from gtmodel.problem_files.run import answer, context_of

    write_synthetic_emps(tmp_path / "log.mat")
    from scipy.io import loadmat

    content = {k: v.T for k, v in loadmat(tmp_path / "log.mat").items() if not k.startswith("__")}
    savemat(tmp_path / "struct.mat", {"rec": content, "n": 1.0})
    results = []
    for file, lead in (("log.mat", ""), ("struct.mat", "rec.")):
        settings = [
            f"log.files=['{tmp_path / file}']", f"log.time.column='{lead}t'", f"log.position.column='{lead}qm'",
            f"log.effort.column='{lead}vir'", f"closed_loop.inputs.qg.column='{lead}qg'",
        ]  # fmt: skip
        problem = load(CLONE / "problems" / "emps.toml", settings)
        results.append(answer(problem, context_of(problem)))
    first, second = (result.values for result in results)
    assert results[0].status is results[1].status
    for name, value in first.items():
        if isinstance(value, (float, dict, list)):
            assert second[name] == value or repr(second[name]) == repr(value), name


def test_an_uneven_log_is_resampled_where_the_file_asks_for_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    uneven = T + 0.0012 * rng.uniform(-1, 1, len(T))
    table = np.column_stack([uneven, np.sin(20 * uneven), np.cos(20 * uneven)])
    text(rows=np.delete(table, [20, 21], axis=0))(tmp_path)
    keys: dict[str, Any] = {
        "files": ["log.csv"], "time": {"column": "t"}, "position": POSITION | {"unit": "m"}, "effort": EFFORT
    }  # fmt: skip

    def read(**more: Any) -> Any:
        section = IdentificationLogSection.model_validate(keys | more)
        signals = {"q": section.position.signal("position", "m"), "f": section.effort.signal("effort", "N")}
        return section.sessions(signals, Context(folder=tmp_path))

    with pytest.raises(InputError) as error:
        read()
    assert error.value.key == "log"
    (session,) = read(resample={"sample_time_s": 0.004})
    t = session.trajectory.time
    assert np.diff(t) == pytest.approx(0.004) and session.trajectory["q"] == pytest.approx(np.sin(20 * t), abs=2e-4)
    with pytest.raises(InputError) as error:
        read(resample={"longest_gap_s": 1e-5})
    assert error.value.key == "log.resample.longest_gap_s"
