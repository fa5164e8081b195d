"""The study of dynamic stiffness, called on objects: synthetic experiments, measured records, what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.robots.kuka import table_16
from gtmodel.vibration import dynamic_stiffness_study, load_oscillator_field, synthetic_hits
from gtmodel.vibration.dynamic_stiffness import (
    FrequencyMap,
    ModalFitting,
    Process,
    SyntheticArm,
    read_experiments,
    synthetic_experiments,
)  # fmt: skip

ONE_START = Process(starts=1)
SMALL = SyntheticArm(seed=16, poses=12, records="receptance")


@pytest.fixture(scope="module")
def made():
    return synthetic_experiments(table_16(), SMALL)


@pytest.fixture(scope="module")
def small(made):
    return dynamic_stiffness_study(made, process=ONE_START)


def test_synthetic_experiments_are_recovered_and_say_what_they_are(small) -> None:
    assert small.status is SolveStatus.SOLVED
    assert all(check.passed for check in small.checks.values()), small.checks
    assert len(small.mass) == 36 and np.all(np.isfinite(small.stiffness))
    # 5 % of noise on a receptance: half to two per cent of m and k
    relative = np.array(small.relative_std)
    assert 0.002 < np.median(relative[:, 2]) < 0.02
    assert "seed 16, noise 0.05 of each receptance, scatter 0.133" in small.synthetic
    for name in ("oscillators.toml", "poses.csv"):
        assert small.files[name].startswith("# SYNTHETIC: seed 16")
    assert small.files["oscillators.c"].startswith("/* SYNTHETIC: seed 16")
    assert "regression and not its training data; its c_z repeats m_z" in small.printed


NOTHING = ["stiffness", "stiffness[02", "stiffness[\u00b2]", "stiffness[36]", "k[0]", "", None, 3]


@pytest.mark.parametrize("name", NOTHING)
def test_an_interval_of_nothing_is_refused(small, name) -> None:
    with pytest.raises(ArgumentError, match="expected one of mass, damping, stiffness"):
        small.interval(name)
    with pytest.raises(ArgumentError, match="expected m, c, k"):
        small.fits[0].interval("k[3]" if name else "what[0]")


def test_coverage_is_told_before_and_after_widening(small) -> None:
    before, after = small.coverage_held_out
    assert 0.5 < before <= after <= 1 and small.coverage_of_truth[1] >= small.coverage_of_truth[0]
    assert min(small.inflation) >= 1 and len(small.leave_one_out_rms) == 9
    labels = [row.label for row in small.rows]
    assert (
        "held-out values inside their 95 % intervals" in labels
        and "true field at 200 new poses inside the intervals" in labels
    )


def test_the_file_of_oscillators_is_what_milling_loads(small, tmp_path) -> None:
    path = tmp_path / "oscillators.toml"
    path.write_text(small.files["oscillators.toml"], encoding="utf-8")
    field = load_oscillator_field(path)
    m, c, k = field.at(table_16().poses[0])
    assert m.shape == c.shape == k.shape == (3,) and np.all(m > 0)
    f = field.casadi_function()
    np.testing.assert_allclose(np.array(f(table_16().poses[0])[2]).ravel(), k, rtol=1e-10)


def test_pictures_are_drawn_and_marked(small) -> None:
    assert list(small.figures) == ["frequency_response", "lowest_frequency", "held_out"]
    for name in small.figures:
        assert "synthetic: seed 16" in small.figure(name).get_suptitle()


def test_hits_are_recovered() -> None:
    few = SyntheticArm(seed=16, poses=8, hits=2, duration=2.0)
    found, again = (
        dynamic_stiffness_study(synthetic_experiments(table_16(), few), process=ONE_START) for _ in range(2)
    )
    assert np.all(np.isfinite(found.mass)) and np.max(np.array(found.relative_std)[:, 3]) < 0.01
    assert set(found.modes) == {1}
    assert again.files == found.files  # the same bytes


def test_stopped_it_keeps_what_was_fitted(made) -> None:
    asked: list[None] = []

    def stop() -> bool:
        asked.append(None)
        return len(asked) > 3

    found = dynamic_stiffness_study(made, stop=stop)
    assert found.status is SolveStatus.INTERRUPTED and len(found.mass) == 3 and np.all(np.isfinite(found.mass))
    assert found.field is None and not found.files and found.rows
    none = dynamic_stiffness_study(made, stop=lambda: True)
    assert none.status is SolveStatus.INTERRUPTED and len(none.mass) == 0


RATE, STEP = 512.0, 0.25
HEAD = "x [mm],y [mm],z [mm],A [deg],direction,file,experiment\n"


@pytest.fixture(scope="module")
def measured(tmp_path_factory) -> Path:
    """Eight poses: two hits of each in x as records, in y as inertance, in z as receptance in um/N."""
    folder = tmp_path_factory.mktemp("measured")
    rng = np.random.default_rng(3)
    rows = []
    for n in range(8):
        place = f"{100 * n},{-2400 - 50 * n},300,{10 * n}"
        m, k = 200.0 + 10 * n, 3e6
        c = 2 * 0.08 * np.sqrt(m * k)
        F, x = synthetic_hits(
            *map(np.atleast_1d, (m, c, k)), sample_rate=RATE, duration=2.0, hits=2, noise=1e-3, seed=rng
        )
        for h in range(2):
            t = np.arange(F.shape[1]) / RATE
            table = np.column_stack([1e3 * t, F[h] / 1e3, x[h]])
            np.savetxt(
                folder / f"x{n}_{h}.csv",
                table,
                "%.12g",
                ",",
                header="time [ms],force [kN],acceleration [m/s2]",
                comments="",
            )
            rows.append(f"{place},x,x{n}_{h}.csv,")
        f = np.arange(1.0, 100.0, STEP)
        s = 2j * np.pi * f
        H = 1 / (m * s**2 + c * s + k)
        for d, values, unit in (("y", H * s**2, "m/(N.s2)"), ("z", 1e6 * H, "um/N")):
            table = np.column_stack([f, values.real, values.imag])
            np.savetxt(
                folder / f"{d}{n}.csv",
                table,
                "%.15g",
                ",",
                header=f"frequency [Hz],real [{unit}],imaginary [{unit}]",
                comments="",
            )
            rows.append(f"{place},{d},{d}{n}.csv,first")
    rows.append(f"0,-2400,300,0,y,{'y1.csv'},second")  # repeated at the first pose: five per cent off in m
    (folder / "hits.csv").write_text(HEAD + "\n".join(rows) + "\n")
    return folder


def test_measured_records_with_their_units(measured) -> None:
    experiments = read_experiments(measured / "hits.csv")
    found = dynamic_stiffness_study(experiments, process=ONE_START)
    direction = np.array(found.direction)
    m = 200.0 + 10 * np.arange(8)
    first = [found.mass[direction == d][:8] for d in "xyz"]
    np.testing.assert_allclose(first[0], m, rtol=0.02)
    np.testing.assert_allclose(first[1], m, rtol=1e-6)
    np.testing.assert_allclose(first[2], m, rtol=1e-6)
    np.testing.assert_allclose(found.poses[0], [0.0, -2.4, 0.3, 0.0])
    expected = np.mean([np.log(210 / 200), np.log(210 / 200) / 2, 0.0])
    assert found.measured_repeatability == pytest.approx(expected, rel=1e-3)
    assert found.synthetic is None and found.coverage_of_truth is None and found.printed is None
    assert {"x3_0.csv", "x3_1.csv"} in [set(e.files) for e in experiments]
    assert not found.files["poses.csv"].startswith("#")


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("0,0,0,0,w,z0.csv,", r"hits.csv line 2: found the direction 'w'; expected x, y or z"),
        ("0,0,0,0,x,none.csv,", r"there is no file 'none.csv'"),
        ("0,0,0,a,x,z0.csv,", r"hits.csv line 2, column 'A': found 'a'; expected a finite number such as 1.5e-3"),
        ("0,0,0,0,x,z0.csv", r"hits.csv line 2: found 6 cells; expected 7"),
        ("0,0,0,0,x,z0.csv,\n0,0,0,0,x,z1.csv,", r"z0.csv is a frequency response"),
        ("0,0,0,0,x,bare.csv,", r"bare.csv: the column 'force' has no unit; write it as 'force \[N\]'"),
        ("0,0,0,0,x,uneven.csv,", r"uneven.csv: the samples are not evenly spaced"),
        ("0,0,0,0,x,index.csv,", r"index.csv: expected the columns time \[s\],force \[N\],acceleration"),
        (
            "0,0,0,0,x,words.csv,",
            r"words.csv line 2, column 'force': found 'a'; expected a finite number such as 1.5e-3",
        ),
    ],
)
def test_wrong_records_are_one_sentence(measured, tmp_path, lines, said) -> None:
    for name in ("z0.csv", "z1.csv"):
        (tmp_path / name).write_bytes((measured / name).read_bytes())
    rows = "\n".join(f"{0.01 * k},{np.exp(-k):.6g},{np.exp(-k):.6g}" for k in range(40))
    (tmp_path / "bare.csv").write_text(f"time [s],force,acceleration [m/s2]\n{rows}\n")
    (tmp_path / "uneven.csv").write_text(f"time [s],force [N],acceleration [m/s2]\n{rows}\n0.5,0,0\n")
    (tmp_path / "words.csv").write_text("time [s],force [N],acceleration [m/s2]\n0,a,1\n")
    (tmp_path / "index.csv").write_text("a,b,c\n1,2,3\n")
    (tmp_path / "hits.csv").write_text(HEAD + lines + "\n")
    with pytest.raises(ArgumentError, match=said):
        read_experiments(tmp_path / "hits.csv")


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"fit": ModalFitting(search=[9.0, 3.0])}, "fit.search"),
        ({"map": FrequencyMap(over=["y", "y"])}, "map.over"),
        ({"fit": ModalFitting(search=[150.0, 190.0], modes=1)}, "experiments"),
    ],
)
def test_what_cannot_be_used_is_named(made, options, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        dynamic_stiffness_study(made, process=ONE_START, **options)
    assert caught.value.argument == argument


def test_a_box_without_room_is_named() -> None:
    for box in ({"box_angle": [0.2, 0.1]}, {"box": [[0.0, 1.0]]}):
        with pytest.raises(ArgumentError) as caught:
            synthetic_experiments(table_16(), SyntheticArm(seed=1, **box))
        assert caught.value.argument == "synthetic.box"
