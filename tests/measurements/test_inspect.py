"""What `gtmodel inspect` says of a log: guesses are called so, and what is wrong with it is seen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gtmodel.cli import main
from gtmodel.measurements import InspectionStudy, LogError, LogForm, inspect
from gtmodel.measurements.inspection.columns import ColumnScan, quantum
from gtmodel.results import SolveStatus
from gtmodel.results.table import cells
from tests.support.picture_faults import faults

N = 3000


def log(folder: Path, **columns: np.ndarray) -> Path:
    names, table = list(columns), np.column_stack(list(columns.values())).tolist()
    rows = [",".join("" if x != x else repr(x) for x in row) for row in table]
    (folder / "log.csv").write_text("\n".join([",".join(n.replace("__", " ") for n in names), *rows]) + "\n")
    return folder / "log.csv"


def units(study: InspectionStudy) -> dict[str, str]:
    (stream,) = study.inspected
    return {c.name: g.unit for c, g in zip(stream.columns, stream.guesses, strict=True)}


T = 0.004 * np.arange(N)
WAVE = np.sin(2 * np.pi * 0.7 * T)
NOISE = np.random.default_rng(5).standard_normal((N, 3))  # synthetic: seed 5


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [
        ("force_N", 300 * WAVE, "N"),
        ("axis.position_deg", 90 * WAVE, "deg"),
        ("act_vel_deg_per_s", 90 * WAVE, "deg/s"),
        ("torque_Nm", 3 * WAVE, "N.m"),
        ("v_m_s", 3 * WAVE, "m/s"),
        ("joint_1", 1.5 * WAVE, "rad"),
        ("joint_1", 95.0 * WAVE, "deg"),
        ("tcp_x", 500 * WAVE, "mm"),
        ("tcp_x", 0.5 * WAVE, "m"),
        ("gyro_x", 200 * WAVE, "deg/s"),
        ("gyro_x", 3 * WAVE, "rad/s"),
        ("current", 3 * WAVE, "A"),
        ("motor_current_2", 3 * WAVE, "A"),
        ("current_limit", 3 * WAVE, ""),
        ("force", 3 * WAVE, ""),
    ],
)
def test_a_unit_is_guessed_from_name_and_range(tmp_path: Path, name: str, values: np.ndarray, unit: str) -> None:
    study = inspect(log(tmp_path, t=T, **{name: values}))
    assert units(study) == {"t": "s", name: unit}
    (column,) = (c for c in study.streams["table"]["columns"] if c["name"] == name)
    assert column["unit_from"] == ("guess" if unit else "") and bool(column["why"]) == bool(unit)


def test_a_unit_of_the_header_is_no_guess(tmp_path: Path) -> None:
    study = inspect(log(tmp_path, **{"t__[ms]": 1000 * T, "x__[mm]": 3 * WAVE}))
    assert units(study) == {"t": "ms", "x": "mm"}
    assert [c["unit_from"] for c in study.streams["table"]["columns"]] == ["header", "header"]
    assert study.inspected[0].clock.sampling.rate == pytest.approx(250.0)  # type: ignore[union-attr]


@pytest.mark.parametrize(("scale", "said"), [(9.81, "9.81 m/s2"), (1.0, "unit is probably g")])
def test_an_acceleration_at_rest_is_gravity(tmp_path: Path, scale: float, said: str) -> None:
    at_rest = scale * (np.array([0.1, -0.2, 0.97]) / np.linalg.norm([0.1, -0.2, 0.97]) + 0.002 * NOISE)
    study = inspect(log(tmp_path, t=T, **{f"acc_{x}": at_rest[:, k] for k, x in enumerate("xyz")}))
    assert any(said in note for note in study.notes)


@pytest.mark.parametrize(("step", "unit"), [(0.004, "s"), (4.0, "ms"), (4000.0, "us"), (4e6, "ns")])
def test_the_unit_of_a_time_by_its_step(tmp_path: Path, step: float, unit: str) -> None:
    study = inspect(log(tmp_path, time=step * np.arange(N), x=WAVE))
    clock = study.inspected[0].clock
    assert clock is not None and clock.unit == unit and clock.sampling.rate == pytest.approx(250.0, rel=1e-6)


def test_gaps_resets_and_two_clocks(tmp_path: Path) -> None:
    time = T.copy()
    time[2000:] += 0.1
    other = 5.0 + time * (1 + 80e-6) + 1e-4 * NOISE[:, 0]
    study = inspect(log(tmp_path, t_s=time, stamp_ms=1e3 * other, x=WAVE))
    (stream,) = study.inspected
    (pair,) = stream.pairs
    assert (pair.first, pair.other) == ("t_s", "stamp_ms")
    assert pair.offset == pytest.approx(5.0, abs=1e-4) and 1e6 * pair.drift == pytest.approx(80.0, abs=2.0)
    assert pair.residual == pytest.approx(1e-4, rel=0.1)
    gap = stream.clocks[0].sampling.gaps
    assert [g.missing for g in gap] == [25] and any("one gap" in note for note in study.notes)
    time[2500:] -= time[2500]
    assert any("goes back once" in note for note in inspect(log(tmp_path, t_s=time, x=WAVE)).notes)


def test_columns_that_are_worth_a_look(tmp_path: Path) -> None:
    clipped = np.clip(3 * WAVE + 0.01 * NOISE[:, 0], -2.0, 2.0)
    holes = WAVE.copy()
    holes[100:110] = np.nan
    rests = np.where(T > 6, 1.0, np.minimum(T / 6, 1.0))
    study = inspect(
        log(tmp_path, t=T, u=clipped, holes=holes, zero=0 * T, coarse=np.round(WAVE / 0.05) * 0.05, rests=rests)
    )
    (stream,) = study.inspected
    facts = {c.name: c for c in stream.columns}
    assert facts["u"].clipped > 100 and facts["u"].most == 2.0
    assert facts["holes"].empty == 10 and facts["holes"].rows == N - 10
    assert facts["zero"].constant and facts["coarse"].step == pytest.approx(0.05) and facts["t"].step
    assert not facts["rests"].clipped and facts["rests"].longest > 1000
    said = " ".join(study.notes)
    assert "looks clipped" in said and "constant: zero" in said and "without a number in holes (10)" in said


def test_facts_do_not_depend_on_the_blocks() -> None:
    values = np.column_stack([T, np.clip(3 * WAVE, -2, 2), np.where(NOISE[:, 0] > 2, np.nan, NOISE[:, 1]), 0 * T])
    whole = ColumnScan(["t", "u", "n", "z"], ["t"])
    whole.add(values)
    for size in (1, 7, 1000):
        parts = ColumnScan(["t", "u", "n", "z"], ["t"])
        for begin in range(0, N, size):
            parts.add(values[begin : begin + size])
        for a, b in zip(parts.facts(), whole.facts(), strict=True):
            for name, value in vars(b).items():
                if isinstance(value, float):
                    np.testing.assert_allclose(getattr(a, name), value, rtol=1e-12, err_msg=name)
                else:
                    assert getattr(a, name) == value, name
        np.testing.assert_array_equal(parts.numbers("t"), T)
        np.testing.assert_array_equal(parts.envelope.low, whole.envelope.low)
        np.testing.assert_array_equal(parts.envelope.high, whole.envelope.high)


def test_the_step_of_a_converter() -> None:
    rng = np.random.default_rng(6)  # synthetic: seed 6
    for bits in (0.1, 360 / 4096, 1.5e-6):
        assert quantum(np.round(rng.normal(0, 8, 5000)) * bits) == pytest.approx(bits, rel=1e-6)
    assert quantum(rng.standard_normal(5000)) == 0.0 and quantum(np.zeros(5)) == 0.0


def test_a_stop_keeps_what_was_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gtmodel.measurements.streams import text_lines

    path = log(tmp_path, t=T, x=WAVE)
    small = lambda path, encoding: text_lines.chunks(path, encoding, 2000)  # noqa: E731
    monkeypatch.setattr("gtmodel.measurements.streams.text.chunks", small)
    shown: list[float] = []
    study = inspect(
        path, progress=lambda stage, fraction, numbers=None: shown.append(fraction), stop=lambda: len(shown) > 3
    )  # type: ignore[arg-type]
    assert study.status is SolveStatus.INTERRUPTED and 0 < study.inspected[0].rows < N
    assert shown == sorted(shown) and "stopped after row" in study.notes[-1] + " ".join(study.notes)


def test_bags_and_tables_of_other_programs(tmp_path: Path) -> None:
    from tests.measurements.test_damaged_logs import bag, parquet

    (tmp_path / "log.parquet").write_bytes(parquet(tmp_path))
    (tmp_path / "log.bag").write_bytes(bag(tmp_path))
    study = inspect(tmp_path / "log.parquet")
    assert study.streams["table"]["rows"] == 40 and "no numbers in word" in study.notes
    study = inspect(tmp_path / "log.bag")
    assert list(study.streams) == ["/x"] and study.inspected[0].clock is not None
    assert study.inspected[0].clock.sampling.rate == pytest.approx(250.0, rel=1e-6)
    assert any("its time is the time of reception" in note for note in study.notes)


def test_words_and_dates_in_columns(tmp_path: Path) -> None:
    rows = [f"2026-11-23T00:00:{k % 60:02d}.5,{'run' if k % 3 else 'stop'},{k % 7}.5" for k in range(60)]
    (tmp_path / "log.csv").write_text("when,state,x\n" + "\n".join(rows) + "\n")
    study = inspect(tmp_path / "log.csv")
    (stream,) = study.inspected
    assert stream.clock is not None and (stream.clock.name, stream.clock.unit) == ("when", "s")
    assert stream.clock.sampling.rate == pytest.approx(1.0) and "no numbers in state" in study.notes


ROWS = [f"{0.01 * k:.2f},{k % 9},{k % 7 - 3}" for k in range(60)]


def said_of(folder: Path, header: str, rows: list[str]) -> str:
    (folder / "log.csv").write_text("\n".join([header, *rows]) + "\n")
    return "\n".join(inspect(folder / "log.csv").notes)


def test_columns_that_are_not_looked_at_are_named(tmp_path: Path) -> None:
    assert "columns 2, 3 are all called 'x'" in said_of(tmp_path, "t_s,x,x", ROWS)
    assert "column 2 has no name" in said_of(tmp_path, "t_s,,x", ROWS)
    assert "ignored" not in said_of(tmp_path, "t_s,x,y", ROWS)


def test_a_word_among_numbers_is_shown_with_its_line(tmp_path: Path) -> None:
    said = said_of(tmp_path, "t_s,x,y", [*ROWS[:30], "0.30,error 7,1", "0.31,,nan", *ROWS[32:]])
    assert "line 32, column 'x': 'error 7' is not a number and counts as empty" in said and "column 'y'" not in said
    several = [row.replace(",", ";").replace(".", ",") for row in ROWS]
    assert 'decimal = "comma"' in said_of(tmp_path, "t_s;x;y", several)


def test_a_typeset_minus_is_a_minus(tmp_path: Path) -> None:
    """Rows with U+2212 were taken for empty ones, and the negative half of a signal was lost."""
    said = said_of(tmp_path, "t_s,x,y", [row.replace("-", "\N{MINUS SIGN}") for row in ROWS])
    study = inspect(tmp_path / "log.csv")
    facts = study.inspected[0].columns[2]
    assert "number" not in said and (facts.least, facts.empty) == (-3.0, 0)


def test_a_unit_that_the_name_contradicts_is_pointed_out(tmp_path: Path) -> None:
    said = said_of(tmp_path, "t_s [ms],x_deg [deg],y_mm [m]", ROWS)
    assert "says ms of 't_s', whose name ends in s" in said and "'y_mm'" in said and "'x_deg'" not in said


def test_a_file_without_rows_is_refused(tmp_path: Path) -> None:
    """It was "solved" with no streams."""
    with pytest.raises(LogError, match="no rows"):
        said_of(tmp_path, "t_s,x,y", [])
    (tmp_path / "log.csv").write_text("t_s,x\n0,1\n1,2\n")
    with pytest.raises(LogError, match="no stream 'imu'"):
        inspect(tmp_path / "log.csv", LogForm(stream="imu"))


def test_round_off_of_times_is_no_jitter(tmp_path: Path) -> None:
    """It was 1.6e-12 %."""
    study = inspect(log(tmp_path, t=(4.0 * np.arange(N) + 0.1) * 1e-3 + 100.0, x=WAVE))
    assert study.inspected[0].clock is not None and study.inspected[0].clock.sampling.jitter == 0.0


def test_a_time_that_is_no_time_leaves_shares_of_one(tmp_path: Path) -> None:
    t = T.copy()
    t[700] = 1e300
    study = inspect(log(tmp_path, t=t, x=WAVE))
    assert study.inspected[0].clock is not None and 0.0 < study.inspected[0].clock.sampling.missing <= 1.0


def test_the_picture(tmp_path: Path) -> None:
    columns = {f"q_{k}": WAVE + k for k in range(3)}
    study = inspect(log(tmp_path, t=np.cumsum(0.004 + 0.0002 * NOISE[:, 0]), **columns, u=300 * WAVE))
    figure = study.figure("log")
    assert len(figure.axes) == 3 and not faults(figure)


def test_round_off_of_the_steps_is_not_drawn_as_jitter(tmp_path: Path) -> None:
    figure = inspect(log(tmp_path, t=T + 100.0, x=WAVE)).figure("log")
    low, high = figure.axes[-1].get_ylim()
    assert (low, high) == pytest.approx((0.99 * 0.004, 1.01 * 0.004))


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = log(tmp_path, t=T, force_N=WAVE)
    assert main(["inspect", str(path), "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert "250 Hz" in printed and "force_N" in printed and "N ?" in printed
    assert main(["inspect", str(path), "--json", "--quiet"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["kind"] == "inspect" and data["status"] == "solved"
    assert data["values"]["streams"]["table"]["clocks"][0]["rate_Hz"] == pytest.approx(250.0)
    out = tmp_path / "out"
    assert main(["inspect", str(path), "--out", str(out), "--plot", "--quiet"]) == 0
    assert {p.name for p in out.iterdir()} >= {"result.json", "log.png", "run.toml"}
    first = (out / "result.json").read_bytes()
    assert (
        main(["inspect", str(path), "--out", str(out), "--quiet"]) == 0 and (out / "result.json").read_bytes() == first
    )
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nothing.csv"], "there is no file"),
        (["log.csv", "--decimal", "dot"], "--decimal"),
        (["log.csv", "--header", "-1"], "--header"),
        (["bad.csv"], "bad.csv: line 3"),
        (["log.csv", "--header", "50"], "log.csv: has no line 50"),
        (["log.csv", "--out", "full"], "--out"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(
    tmp_path: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log(tmp_path, t=T[:9], x=WAVE[:9])
    (tmp_path / "bad.csv").write_text("t,x\n0,1\n1,2,3\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    assert main(["inspect", *words, "--quiet"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and said in lines[0]


@pytest.mark.parametrize(
    ("text", "language"),
    [
        ("MODULE ServoMove\n  VAR egmident id;\n  PROC main()\n  ENDPROC\nENDMODULE\n", "RAPID"),
        ("%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\n! a, b\nMODULE Data(SYSMODULE)\nENDMODULE\n", "RAPID"),
        ("module m\n const num a:=1;\nendmodule\n", "RAPID"),
        ("LOCAL PROC main()\n MoveL p10,v100,z1,tool0;\n MoveL p10,v100,z1,tool0;\nENDPROC\n", "RAPID"),
        ("def prog():\n  movej([0.1, -1.57], a=1.4)\nend\n", "URScript"),
        ("/PROG  MOVE1\n/ATTR\nOWNER = A;\n/MN\n", "TP"),
        ("&ACCESS RVP\n&REL 1\nDEF main( )\nINI\nPTP HOME\nEND\n", "KRL"),
    ],
)
def test_a_controllers_program_is_said_to_be_one(tmp_path: Path, text: str, language: str) -> None:
    """It was read as a table whose second line has a cell too many."""
    for name in ("move.mod", "move.txt"):
        (tmp_path / name).write_text(text)
        with pytest.raises(LogError, match=rf"program of a robot controller \({language}\), a text without a table"):
            inspect(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "kind"),
    [('<?xml version="1.0" ?>\n<Program>\n  <M>a</M>\n</Program>\n', "XML"), ('{"a": [1],\n "b": [3]}\n', "JSON")],
)
def test_a_tree_is_no_table(tmp_path: Path, text: str, kind: str) -> None:
    (tmp_path / "log.txt").write_text(text)
    with pytest.raises(LogError, match=f"is {kind}, a text without a table"):
        inspect(tmp_path / "log.txt")


# -- files as they come from the machine ----

RIG = "Rig, axis X\nDate: 12.11.2026   Drive: 400\nNote: three sines\n"


def rig(head: str = RIG, time: str = "{k}", count: int = 40) -> str:
    """A table with decimal commas below lines of a program. synthetic: a straight line."""
    rows = [f"{time.format(k=k)};{0.5 * k:.3f};{3.0 - k:.2f}".replace(".", ",") for k in range(count)]
    return head + "Zeit [ms];Position [mm];Kraft [N]\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize(("head", "line"), [(RIG, 4), ("Rig\n", 2), ("Rig; axis\nmade; today\n", 3), ("", 0)])
def test_the_header_and_the_decimal_commas_are_found(tmp_path: Path, head: str, line: int) -> None:
    (tmp_path / "log.csv").write_text(rig(head))
    study = inspect(tmp_path / "log.csv")
    (stream,) = study.inspected
    assert [c.name for c in stream.columns] == ["Zeit", "Position", "Kraft"] and stream.rows == 40
    assert stream.columns[1].most == 19.5 and stream.clock is not None
    said = "\n".join(study.notes)
    assert stream.clock.sampling.rate == pytest.approx(1000.0)
    assert 'decimal = "comma"' in said and (f"header = {line}" in said) == bool(line)
    assert "seem" not in said and "no numbers" not in said


def test_rows_of_decimal_commas_are_no_header(tmp_path: Path) -> None:
    for rows in ("0,0;1,5\n0,1;2,5\n0,2;3,5\n", "0;1,5\n1;2,5\n2;3,5\n"):
        (tmp_path / "log.csv").write_text(rows)
        (stream,) = inspect(tmp_path / "log.csv").inspected
        assert [c.name for c in stream.columns] == ["1", "2"] and stream.columns[1].least == 1.5


def test_a_declared_header_of_numbers_is_doubted(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("0.0,1.0\n0.1,1.2\n0.2,1.3\n")
    assert "header = 0" in "\n".join(inspect(tmp_path / "log.csv", LogForm(header=1)).notes)
    assert "header = 0" not in "\n".join(inspect(tmp_path / "log.csv").notes)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ((RIG + "Prüfer\nt;x\n0;1\n").encode("cp1252"), "--encoding cp1252"),
        (b"one\nt;x\n0;1\n1;2\n", "give --header 2"),
    ],
)
def test_the_command_names_its_options(
    tmp_path: Path, content: bytes, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log.csv").write_bytes(content)
    assert main(["inspect", str(tmp_path / "log.csv"), "--quiet"]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "This is prose.\nIt has some words, and lines.\nNo number at all, really, none.\nEnd.\nMore.\n",
        "one\ntwo\nthree\nfour\n",
    ],
)
def test_a_text_without_a_table_is_said_to_be_one(tmp_path: Path, text: str) -> None:
    (tmp_path / "log.txt").write_text(text)
    with pytest.raises(LogError, match="a text without a table"):
        inspect(tmp_path / "log.txt")


def test_poses_are_no_recording(tmp_path: Path) -> None:
    """The tool position T was a time that went back 43 times."""
    rng = np.random.default_rng(3)  # synthetic: seed 3
    columns = {f"T[{k}]": 1000 * rng.standard_normal(90) for k in range(3)}
    study = inspect(log(tmp_path, **{"point": np.arange(1.0, 91.0)}, **columns))
    (stream,) = study.inspected
    said = "\n".join(study.notes)
    assert not stream.clocks and "90 rows and no time column" in said and "goes back" not in said
    assert stream.guesses[0].unit == "1" and "an index" in stream.guesses[0].why
    assert not any(row.label.startswith("time") for row in study.rows)


def test_alike_columns_share_a_note(tmp_path: Path) -> None:
    names = ("knee", "hip", "elbow", "wrist")
    study = inspect(log(tmp_path, t=T, **{f"{n}_angle": (k + 30) * WAVE for k, n in enumerate(names)}))
    (note,) = (note for note in study.notes if "named like an angle" in note)
    assert all(n in note for n in names) and "33" in note


def test_a_short_topic_is_shown(tmp_path: Path) -> None:
    """A bag of ten messages was said to be empty."""
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64"
    with rosbag1.Writer(tmp_path / "log.bag") as writer:
        for name, count in (("/x", 10), ("/y", 5)):
            topic = writer.add_connection(name, kind, typestore=store)
            for k in range(count):
                writer.write(topic, 10**18 + 10**7 * k, store.serialize_ros1(store.types[kind](float(k)), kind))
    study = inspect(tmp_path / "log.bag")
    assert {name: stream["rows"] for name, stream in study.streams.items()} == {"/x": 10, "/y": 5}


def test_the_table_says_read_and_the_result_solved(tmp_path: Path) -> None:
    study = inspect(log(tmp_path, t=T, x=WAVE))
    assert study.status is SolveStatus.SOLVED and cells(study)[0][:2] == ("status", "read")
