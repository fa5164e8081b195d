"""Robots whose time stamps, numbers, motors or carts are not as they say: through sockets, and by the pace alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gtmodel.loop import LoopProcess, egm, rsi
from gtmodel.loop.process import COLUMNS, STATES, rows_of
from gtmodel.results import Status
from tests.loop.bench import Bench
from tests.loop.histories import CYCLE_MS, DECELERATION, HOLD, REFERENCE, STEP_M, Sent

PERIOD, AT, CYCLES = CYCLE_MS / 1000.0, 100, 190
GREATEST = float(np.abs(REFERENCE.rows[:, 6:9]).max())  # m/s2, of the reference's carts
BRIDGED = {"stamp stands for a cycle": 1, "unknown type": 3}  # cycles without the law, behind which it goes on
Change = Callable[[list[Sent]], None]


def _moved(first: int, count: int, numbers: int, ms: int) -> Change:
    def change(sent: list[Sent]) -> None:
        for one in sent[first : first + count]:
            one.number += numbers
            one.stamp += ms

    return change


def _stands(first: int, count: int) -> Change:
    def change(sent: list[Sent]) -> None:
        for one in sent[first : first + count]:
            one.stamp = sent[first - 1].stamp

    return change


def _each(first: int, count: int, **values: object) -> Change:
    def change(sent: list[Sent]) -> None:
        for one in sent[first : first + count]:
            for name, value in values.items():
                setattr(one, name, value)

    return change


def _slow(sent: list[Sent]) -> None:
    for n, one in enumerate(sent[AT:], 1):
        one.stamp -= 2 * n


def _apart(sent: list[Sent]) -> None:
    sent[AT].measured_m = sent[AT].measured_m + np.array([0.0, 0.0, 0.5])


# what is changed; clock faults, following faults, garbage; the status of the stop, None for none
EGM: dict[str, tuple[Change, tuple[int, int, int], Status | None]] = {
    "stamp 1000 ms ahead": (_moved(AT, 999, 0, 1000), (1, 0, 0), Status.STALE_INPUT),
    "stamp 40 ms ahead": (_moved(AT, 999, 0, 40), (1, 0, 0), Status.STALE_INPUT),
    "stamp a cycle ahead": (_moved(AT, 999, 0, 4), (0, 0, 0), None),
    "stamp 100 ms back": (_moved(AT, 999, 0, -100), (1, 0, 0), Status.STALE_INPUT),
    "stamp stands for ever": (_stands(AT, 999), (CYCLES - AT, 0, 0), Status.STALE_INPUT),
    "stamp stands for a cycle": (_stands(AT, 1), (1, 0, 0), None),
    "stamp at half speed": (_slow,
                            ((CYCLES - AT) // 4, 0, 0), Status.STALE_INPUT),  # 2 ms, of which 1 is forgotten: 5 in 4
    "numbers run ahead": (_moved(AT, 999, 1000, 0), (1, 0, 0), Status.STALE_INPUT),
    "both run ahead": (_moved(AT, 999, 10, 40), (0, 0, 0), Status.STALE_INPUT),
    "motors off": (_each(AT, 1, motors=2), (0, 0, 0), Status.STALE_INPUT),
    "motors unknown": (_each(AT, 1, motors=0), (0, 0, 0), None),
    "unknown type": (_each(AT, 3, kind=7), (0, 0, 3), None),
    "a sensor's type": (_each(AT, 10, kind=egm.TYPE_CORRECTION), (0, 0, 10), Status.STALE_INPUT),
    "half a metre away": (_apart, (0, 1, 0), Status.OUT_OF_RANGE),
}  # fmt: skip
RSI: dict[str, tuple[Change, tuple[int, int, int], Status | None]] = {
    "IPOC 1000 ms ahead": (_moved(AT, 999, 250, 0), (0, 0, 0), Status.STALE_INPUT),
    "IPOC 40 ms ahead": (_moved(AT, 999, 10, 0), (0, 0, 0), Status.STALE_INPUT),
    "IPOC 100 ms back": (_moved(AT, 999, -25, 0), (0, 0, 0), Status.STALE_INPUT),
    "half a metre away": (_apart, (0, 1, 0), Status.OUT_OF_RANGE),
}


@pytest.mark.parametrize(("protocol", "name"), [*(("egm", name) for name in EGM), *(("rsi", name) for name in RSI)])
def test_through_sockets_in_lock_step(bench: Bench, tmp_path: Path, protocol: str, name: str) -> None:
    """The issue's own case: law trajectory, --step 0.02 --hold 5 --deceleration 2, 0.2 m in 1.2 s."""
    change, (clock, following, garbage), why = (EGM if protocol == "egm" else RSI)[name]
    sent = [Sent(n, 10_000 + CYCLE_MS * n, REFERENCE.rows[n, :3]) for n in range(CYCLES)]
    change(sent)
    table, log = tmp_path / "reference.table", tmp_path / "loop.log"
    table.write_bytes(REFERENCE.to_bytes())
    words = ["--peer", protocol, "--law", "trajectory", "--lockstep", "--live", "--reference", str(table), "--log"]
    words += [str(log), "--step", "0.02", "--hold", str(HOLD), "--deceleration", "2", "--cycles", str(CYCLES)]
    position, speed = [], []
    with LoopProcess(bench.program, words) as process:
        for one in sent:
            for answer in process.exchange([one.bytes_of(protocol)]):
                read = rsi.decode_sensor(answer).ek_mm if protocol == "rsi" else egm.decode_sensor(answer).external_mm
                position.append([x / 1000.0 for x in read[:3]])
                if protocol == "egm":
                    speed.append([x / 1000.0 for x in egm.decode_sensor(answer).external_speeds_mm_s])
        report = process.finish()
    assert (report["clock_faults"], report["following_faults"], report["garbage"]) == (clock, following, garbage)
    assert STATES[report["state"]] == ("running" if why is None else "stopped")
    assert report["status"] == (Status.OK if why is None else why)
    rows = rows_of(log.read_bytes())
    way = np.diff(position, axis=0)
    assert np.abs(way).max() <= STEP_M
    if protocol == "egm":
        assert np.abs(np.array(speed)[1:] * PERIOD - way).max() < 1e-14
    # the law is m (m + 1) / 2 of a h^2 away from the speed that was held for m cycles, and its own speed m + 1 of a h
    m = BRIDGED.get(name, 0)
    steepest = np.abs(np.diff(rows[:, 27:30], axis=0)).max() / PERIOD
    assert steepest <= max(DECELERATION, (m + 1) * (m + 2) / 2 * GREATEST) * (1 + 1e-6)
    assert list(rows[-1, [COLUMNS.index("clock_faults"), COLUMNS.index("following_faults")]]) == [clock, following]
