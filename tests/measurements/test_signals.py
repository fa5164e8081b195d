"""Delay, scale and offset of a signal: what a number does, and that free ones are found again."""

from pathlib import Path

import numpy as np
import pytest

from gtmodel.measurements import ESTIMATE, Column, Corrections, LogError, Session, Signal, offset_columns, read_signals
from gtmodel.results import Trajectory

DT = 0.002
TIME = DT * np.arange(1500)


def force(t: np.ndarray) -> np.ndarray:
    return 40 * np.sin(5 * t) + 15 * np.cos(17 * t)


def logged(late: float, gain: float, offset: float) -> Session:
    """A voltage that shows the force `late` seconds later: volts = (force + offset) / gain. Synthetic, no noise."""
    volts = (force(TIME - late) + offset) / gain
    values = {"force": volts, "clock": TIME}
    return Session("made here", Trajectory(TIME, values, {"force": "V", "clock": "s"}, synthetic="no noise"), DT)


def test_fixed_numbers_correct_the_column() -> None:
    signal = Signal("vir", "V", scale=35.0, offset=-3.0, delay=0.0071, quantity_unit="N")
    corrections = Corrections({"force": signal}, [logged(0.0071, 35.0, -3.0)])
    (session,) = corrections.apply()
    done = session.trajectory
    assert corrections.free == () and corrections.estimate(lambda _: np.zeros(1)).size == 0
    assert done.unit("force") == "N" and len(done) == len(TIME) - 2 * 4
    # cubic spline: (w dt)^4 / 384 of 15 N is 1e-7 N
    assert np.abs(done["force"] - force(done["clock"])).max() < 1e-6


def test_free_ones_are_found_again_in_every_session() -> None:
    signal = Signal("vir", "V", scale=ESTIMATE, offset=ESTIMATE, delay=ESTIMATE, quantity_unit="N")
    sessions = [logged(0.0071, 35.0, -3.0), logged(0.0071, 35.0, 2.0)]
    corrections = Corrections({"force": signal}, sessions)
    assert [f.name for f in corrections.free] == [
        "force.delay", "force.scale", "force.offset of session 1", "force.offset of session 2"
    ]  # fmt: skip
    found = corrections.estimate(
        lambda done: np.concatenate([s.trajectory["force"] - force(s.trajectory["clock"]) for s in done])
    )
    assert found == pytest.approx([0.0071, 35.0, -3.0, 2.0], rel=1e-5)
    assert corrections.named(found)["force.delay"] == found[0]


def test_a_delay_may_differ_from_session_to_session() -> None:
    signal = Signal("vir", "V", scale=35.0, delay=ESTIMATE, quantity_unit="N", per_session=("delay",))
    corrections = Corrections({"force": signal}, [logged(0.0071, 35.0, 0.0), logged(-0.004, 35.0, 0.0)])
    found = corrections.estimate(
        lambda done: np.concatenate([s.trajectory["force"] - force(s.trajectory["clock"]) for s in done])
    )
    assert found == pytest.approx([0.0071, -0.004], abs=1e-8)


def test_a_delay_at_its_bound_is_told() -> None:
    signal = Signal("vir", "V", scale=35.0, delay=ESTIMATE, quantity_unit="N")
    corrections = Corrections({"force": signal}, [logged(0.03, 35.0, 0.0)], longest_delay=0.01)
    with pytest.raises(LogError, match=r"the estimate of force.delay has reached its bound, 10 ms"):
        corrections.estimate(lambda done: done[0].trajectory["force"] - force(done[0].trajectory["clock"]))


def test_a_scale_counts_in_the_declared_unit(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t,x,y\n" + "\n".join(f"{k},{k * 1000},{k}" for k in range(5)) + "\n", encoding="utf-8")
    signals = {
        "force": Signal("x", "mm", scale=2.0, quantity_unit="N"),  # N per mm
        "q": Signal("x", "mm", scale=2.0),
        "both": Signal(("x", "y"), "m", offset=1.0),
    }
    sessions = read_signals([path, path], signals, time=Column("t", "s"))
    done = Corrections(signals, sessions).apply()
    assert len(done) == 2
    assert np.allclose(done[1].trajectory["force"], 2000 * np.arange(5), atol=1e-9)
    assert np.allclose(done[1].trajectory["q"], 2 * np.arange(5), atol=1e-12)
    assert np.allclose(done[0].trajectory["both"][4], [3999.0, 3.0], atol=1e-9)


def test_a_quantity_of_another_dimension_needs_a_scale() -> None:
    with pytest.raises(LogError, match=r"the column 'vir' is in V and the quantity in N; give the scale in N per V"):
        Signal("vir", "V", quantity_unit="N")
    with pytest.raises(LogError, match=r"the columns u_1, u_2 are in V and the quantity in N"):
        Signal(("u_1", "u_2"), "V", quantity_unit="N")


def test_offsets_as_columns_of_a_regressor() -> None:
    rows = offset_columns([2, 3], width=2)
    assert rows.shape == (10, 4) and np.array_equal(rows.sum(axis=0), [2, 2, 3, 3])
    # second row of the second session, its first component
    assert np.array_equal(rows[2 * 3], [0, 0, 1, 0])
    assert np.array_equal(offset_columns([2, 3], 1, per_session=False), np.ones((5, 1)))
