"""Lead-through in the loop: C equals its twin, bad sensors brake for good, the C law turns with its scene."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.control.lead_through import WrenchStatus
from gtmodel.loop import LoopProcess, RobotSide, Wrench
from gtmodel.loop.lead_through.law import GuidingLaw, numbers_of
from gtmodel.loop.lead_through.study import PlateScene
from gtmodel.loop.process import STATES, rows_of
from gtmodel.results import Status
from tests.loop.bench import GUIDING, HOLD, Bench
from tests.loop.lead_through_c import COLUMNS, Library, by_python
from tests.loop.test_lockstep import CYCLES, FAULTS

L = gt.control.lead_through
ACCELERATION = GUIDING.gains.acceleration_limit
ROUNDING = 1e-12
# speeds of carts are those of the tool centre point, turned and stretched by the model: sums of a few products
MODEL_ROUNDING = 1e-9
WHY = {
    "stale": Status.STALE_INPUT,
    "missing": Status.STALE_INPUT,
    "saturated": Status.OUT_OF_RANGE,
    "reported": Status.OUT_OF_RANGE,
}
HOSTILE = (float("nan"), float("inf"), -float("inf"), 1e300, -1e308, 100.0, -100.0)
OLD = (4, 5, 1 << 31, (1 << 32) - 1)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library.made(tmp_path_factory.mktemp("lead"))


@pytest.mark.parametrize("cycles", [800, pytest.param(CYCLES, marks=pytest.mark.proof)])
@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_log_equals_the_twins_under_faults(bench: Bench, protocol: str, cycles: int) -> None:
    pair = bench.both(protocol, "lead_through", cycles, FAULTS)
    assert len(rows_of(pair.c_log)) == cycles and pair.c_log == pair.python_log
    assert STATES[pair.report["state"]] in ("running", "holding")
    law = pair.python_loop.law
    assert isinstance(law, GuidingLaw) and law.now is not None and law.now.contact
    assert np.ptp(rows_of(pair.c_log)[:, 21:24], axis=0).max() > 0.01


def _guided(bench: Bench, protocol: str, cycles: int, fault_from: int, fault: str, silent: Any = ()) -> Any:
    """Logs of both loops of a run with a fault of the tool's sensor from a cycle on, and the C loop's report."""
    scene = dataclasses.replace(GUIDING.scene, fault=fault)
    guiding, logs, report = dataclasses.replace(GUIDING, scene=scene), [], {}
    python_loop = bench.python_loop(protocol, "lead_through")
    options = [*bench.options(protocol, "lead_through"), "--cycles", str(cycles), "--deceleration", repr(ACCELERATION)]
    python_loop.settings.deceleration_m_s2 = ACCELERATION
    with LoopProcess(bench.program, options) as process:
        for answering in (process.exchange, python_loop.exchange):
            robot = _robot(bench, protocol, guiding, fault_from)
            for cycle in range(cycles):
                data = robot.datagram()
                robot.step(answering([] if cycle in silent else [data]))
        report = process.finish()
    logs = [bench.log.read_bytes(), bytes(python_loop.log)]
    return rows_of(logs[0]), logs[0] == logs[1], report


def _robot(bench: Bench, protocol: str, guiding: gt.loop.Guiding, fault_from: int | None) -> RobotSide:
    robot = bench.guided(protocol)
    scene = PlateScene(guiding, lambda q: bench.functions["fk"](q)[0], robot.plant, fault_from)
    robot.wrenches = scene.wrenches
    return robot


def _tool(bench: Bench, rows: np.ndarray) -> np.ndarray:
    """Commanded tool centre point (n, 3) [m]."""
    T, status = bench.functions["fk"](rows[:, 21:24])
    assert np.all(status == Status.OK)
    return T


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
@pytest.mark.parametrize("fault", sorted(WHY))
def test_a_bad_sensor_brakes_within_the_acceleration_and_for_good(bench: Bench, protocol: str, fault: str) -> None:
    bad = 300
    rows, equal, report = _guided(bench, protocol, 500, bad, fault)
    assert equal
    old = 3 if fault == "stale" else 0  # readings may be three cycles old
    first = bad + old
    states = [STATES[int(s)] for s in rows[:, 3]]
    assert states[first - 1] == "running" and states[first] == "braking" and states[-1] == "stopped"
    assert report["status"] == WHY[fault] and np.all(rows[first:, 4] == WHY[fault])
    T = _tool(bench, rows)
    speed = np.diff(T, axis=0) / 0.004
    lost = np.linalg.norm(np.diff(speed[first - 2 :], axis=0), axis=1) / 0.004
    assert lost.max() <= ACCELERATION * (1 + 1e-6), "of positions that are differenced twice"
    fast = np.linalg.norm(speed[first - 2])
    way = np.linalg.norm(T[-1] - T[first - 1])
    assert fast > 0.04 and way <= fast**2 / (2 * ACCELERATION)
    assert np.all(np.ptp(rows[first + int(np.ceil(fast / (0.004 * ACCELERATION))) :, 21:24], axis=0) == 0)


def test_while_it_brakes_a_lost_datagram_starts_the_ramp(bench: Bench) -> None:
    rows, equal, report = _guided(bench, "egm", 400, 300, "missing", silent=range(301, 303))
    states = [STATES[int(s)] for s in rows[:, 3]]
    assert equal and states[300:302] == ["braking", "ramping"] and states[-1] == "stopped"
    assert rows[301, 4] == Status.STALE_INPUT and "holding" not in states
    assert report["status"] == Status.STALE_INPUT


def test_lost_datagrams_leave_the_speed_and_the_law_goes_on_from_there(bench: Bench) -> None:
    rows, equal, report = _guided(bench, "egm", 400, 1000, "stale", silent=range(200, 200 + HOLD))
    assert equal and STATES[report["state"]] == "running"
    held = rows[200 : 200 + HOLD, 27:30]
    assert np.all(held == rows[199, 27:30])
    T = _tool(bench, rows)
    speed = np.diff(T, axis=0) / 0.004
    # the carts went on along their own line, the law's sum along the tool's: apart by the bend of the model
    assert np.linalg.norm(np.diff(speed[195:230], axis=0), axis=1).max() <= 0.004 * ACCELERATION * 1.2


@pytest.mark.parametrize(
    "wrong", ["tool", "handle", "no weight", "lighter", "turned", "held", "old", "missing", "reported"]
)
def test_it_does_not_start_where_the_sensors_do_not_weigh_their_loads(bench: Bench, wrong: str) -> None:
    python_loop = bench.python_loop("egm", "lead_through")
    robot = bench.guided("egm")
    sensing = robot.wrenches
    assert sensing is not None

    def spoilt() -> tuple[Wrench, Wrench] | None:
        both = sensing()
        assert both is not None
        handle, tool = both
        if wrong in ("tool", "handle"):
            w, s = (tool, GUIDING.tool) if wrong == "tool" else (handle, GUIDING.handle)
            w.force_N = [2 * b - x for x, b in zip(w.force_N, s.force_bias, strict=True)]
        elif wrong == "no weight":
            tool.force_N = list(GUIDING.tool.force_bias)
        elif wrong == "lighter":  # half of the load, of the right sign: the other half would be a force from outside
            bias = GUIDING.tool.force_bias
            tool.force_N = [b + 0.5 * (x - b) for x, b in zip(tool.force_N, bias, strict=True)]
        elif wrong == "turned":
            x, y, z = (f - b for f, b in zip(tool.force_N, GUIDING.tool.force_bias, strict=True))
            tool.force_N = [
                b + f
                for b, f in zip(GUIDING.tool.force_bias, (x, 0.5 * y - 0.866 * z, 0.866 * y + 0.5 * z), strict=True)
            ]
        elif wrong == "held":
            handle.force_N[2] += 4.0  # the weight of the handle
        elif wrong == "old":
            tool.age_cycles = 4
        elif wrong == "reported":
            tool.status = 9
        return None if wrong == "missing" else (handle, tool)

    robot.wrenches = spoilt
    start = robot.plant.position_m.copy()
    with LoopProcess(bench.program, [*bench.options("egm", "lead_through"), "--cycles", "100"]) as process:
        for _ in range(100):
            data = robot.datagram()
            answers = process.exchange([data])
            assert answers == python_loop.exchange([data])
            robot.step(answers)
        report = process.finish()
    assert bench.log.read_bytes() == bytes(python_loop.log)
    stale = wrong in ("old", "missing")
    assert STATES[report["state"]] == "stopped"
    assert report["status"] == (Status.STALE_INPUT if stale else Status.OUT_OF_RANGE)
    assert np.abs(robot.plant.position_m - start).max() < ROUNDING


def _turned(*vector: float) -> Any:
    return tuple(map(tuple, scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix().tolist()))


def _law(any_direction: bool = False, about: Any = "free", level: float = 0.5, **gains: Any) -> Any:
    reference = {"force_reference": 0.0} if any_direction else {}
    return L.LeadThroughLaw(
        L.SurfaceLaw(
            L.SurfaceGains(any_direction=any_direction, friction=0.1, **reference, **gains),
            watch=L.OscillationWatch(level=level),
        ),
        L.TurningLaw(L.TurningGains(by_handle=True, torque_gain=1.0, about_axis=about)),
        L.MountedSensor(_turned(0.1, 0.2, 0.3), (0, 0.1, 0.2), (1, 2, 3), (0.1, 0.2, 0.3), 0.5, (0, 0.01, 0.05)),
        L.MountedSensor(_turned(1.1, 0.2, 0.3), (0, 0.01, 0.2), (1, -2, 3), (0.1, 0.2, -0.3), 0.8, (0, 0.03, 0.05)),
    )


def _rows(rng: np.random.Generator, count: int) -> np.ndarray:
    """Cycles of a hand that wanders and a tool that touches now and then; the tool turns."""
    rows = np.zeros((count, COLUMNS))
    step = 0.1 * np.cumsum(rng.normal(size=(count, 6)) * [1, 1, 1, 0.03, 0.03, 0.03], axis=0)
    rows[:, :6] = 6 * np.sin(step) * [1, 1, 1, 0.03, 0.03, 0.03] + [1, 2, 3, 0.1, 0.2, 0.3]
    rows[:, 6:12] = [1, -2, 3, 0.1, 0.2, -0.3] + rng.normal(size=(count, 6)) * [4, 4, 6, 0.1, 0.1, 0.1]
    rows[:, 12:14] = rng.integers(0, 4, (count, 2))
    turns = scipy.spatial.transform.Rotation.from_rotvec(np.cumsum(0.01 * rng.normal(size=(count, 3)), axis=0))
    rows[:, 14:] = turns.as_matrix().reshape(count, 9)
    return rows


@pytest.mark.parametrize("any_direction", [False, True])
@pytest.mark.parametrize("about", ["free", "lock", "hold", "guide"])
def test_the_step_in_c_is_the_law_bit_for_bit(library: Library, about: str, any_direction: bool) -> None:
    law, rows = _law(any_direction, about), _rows(np.random.default_rng(4), 2000)
    out = library.cycles(law, rows)
    assert np.array_equal(out, by_python(law, rows))
    assert out[-1, 18] == 1 and 0 < out[:, 12].mean() and np.abs(out[:, 19:22]).max() > 0.01
    assert any_direction or len(np.unique(np.diff(out[:, 12]))) == 3, "contact comes and goes"


def test_a_turned_scene_turns_the_result_in_c(library: Library) -> None:
    Q = scipy.spatial.transform.Rotation.from_rotvec([0.4, 2.0, -0.7]).as_matrix()
    law, rows = _law(), _rows(np.random.default_rng(5), 5000)
    turned_law = dataclasses.replace(
        law, translation=dataclasses.replace(law.translation, normal=tuple((Q @ law.translation.normal).tolist())),
        gravity=tuple((Q @ law.gravity).tolist()),
    )  # fmt: skip
    turned_rows = rows.copy()
    turned_rows[:, 14:] = (Q @ rows[:, 14:].reshape(-1, 3, 3)).reshape(-1, 9)
    a, b = library.cycles(law, rows), library.cycles(turned_law, turned_rows)
    assert np.array_equal(a[:, [12, 13, 17, 18]], b[:, [12, 13, 17, 18]]) and len(np.unique(a[:, 12])) == 2
    for vector in (0, 3, 6, 9, 19, 22, 25):
        assert np.abs(a[:, vector : vector + 3] @ Q.T - b[:, vector : vector + 3]).max() < ROUNDING


def _hostile(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Readings of which one at least is bad, and the status of its cause."""
    rows = _rows(rng, count)
    kinds, places, picks = rng.integers(4, size=count), rng.integers(12, size=count), rng.integers(99, size=count)
    cause = np.zeros(count)
    for k in range(count):
        if kinds[k] < 2:
            value = HOSTILE[picks[k] % len(HOSTILE)]
            rows[k, places[k]] = value
            cause[k] = WrenchStatus.SATURATED if np.isfinite(value) else WrenchStatus.NOT_FINITE
        elif kinds[k] == 2:
            rows[k, 12 + places[k] % 2] = OLD[picks[k] % len(OLD)]
            cause[k] = WrenchStatus.STALE
        else:
            bad = picks[k] % 3
            rows[k, 14 + places[k] % 9] = (np.nan, 3.0, -2.0)[bad]
            cause[k] = WrenchStatus.NO_ROTATION if bad else WrenchStatus.NOT_FINITE
    return rows, cause


SANITIZED = ("-g", "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all")


@pytest.mark.parametrize(
    ("count", "compared", "flags"),
    [
        (5000, 1000, ()),
        pytest.param(100_000, 100_000, (), marks=pytest.mark.proof),
        pytest.param(100_000, 0, SANITIZED, marks=pytest.mark.proof),
    ],
    ids=["few", "many", "many under sanitizers"],
)
def test_hostile_wrenches_only_brake(
    library: Library, tmp_path: Path, count: int, compared: int, flags: tuple[str, ...]
) -> None:
    """Each bad reading from one motion: the state brakes along it; then good and bad ones: it rests."""
    library = Library.made(tmp_path, *flags) if flags else library
    rng, law = np.random.default_rng(6), _law(level=0.0)
    before = _rows(rng, 50)
    before[:, 6:12], before[:, :3], before[:, 14:] = 0.0, [9.0, 8.0, 7.0], np.eye(3).ravel()
    before[:, 12:14] = 0.0
    rows, cause = _hostile(rng, count)
    out = library.cycles(law, np.vstack([before, rows]), again=50)
    assert np.array_equal(out[: 50 + compared], by_python(law, np.vstack([before, rows[:compared]]), again=50))
    moving, bad = out[49], out[50:]
    fast, step = np.linalg.norm(moving[:3]), 0.004 * law.translation.gains.acceleration_limit
    assert fast > 2 * step and np.all(np.isfinite(out))
    assert np.array_equal(bad[:, 17], cause) and not bad[:, 18].any()
    assert np.abs(bad[:, :3] - moving[:3] * (1 - step / fast)).max() < ROUNDING and not bad[:, 3:6].any()
    flickering = rows.copy()
    flickering[1::2] = _rows(rng, len(rows[1::2]))
    out = library.cycles(law, np.vstack([before, flickering]))
    at_rest = 50 + int(np.ceil(fast / step))
    assert not out[at_rest:, :6].any() and not out[at_rest:, 19:25].any() and np.all(np.isfinite(out))
    assert np.all(out[50:, 17] == cause[0]), "the first cause stays"


def test_denormal_readings_are_zeros_that_do_not_stop_it(library: Library) -> None:
    law, rows = _law(), _rows(np.random.default_rng(8), 500)
    rows[:, :12] = np.where(np.random.default_rng(9).random((500, 12)) < 0.5, 5e-324, -2e-310)
    out = library.cycles(law, rows)
    assert out[-1, 18] == 1 and np.all(np.isfinite(out)) and np.array_equal(out, by_python(law, rows))


def test_numbers_that_are_none_of_a_law_are_refused(library: Library) -> None:
    law, row = _law(), np.zeros(COLUMNS)
    good, at = numbers_of(law, 1.0), np.zeros(1)
    assert library.begins(law, row) >= 0
    for k in range(good.rows.shape[1]):
        at = good.rows.copy()
        at[0, k] = np.nan
        assert library.refused(at, row), k
    for k in (0, 1, 2, 3, 6, 10, 12, 16, 18, 22, 26, 31, 36, 38, 68):  # above zero, or a mass that is not below
        at = good.rows.copy()
        at[0, k] = -1.0
        assert library.refused(at, row), k
