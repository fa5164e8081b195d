"""The study of the loop: run the C loop of a generated folder against a simulated controller, along a motion there and
more slowly back; and write the configuration of an RSI controller."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Unpack

import numpy as np
import scipy

from ..compiler.causal import compile_causal
from ..lang import Model
from ..results import ArgumentError, Check, SolveStatus, Status, Trajectory, Work, at_least, at_most
from ..results.disk import scratch
from ..results.options import Within
from ..results.refusal import naming
from ..results.work import WorkOptions, study_function
from .build import GeneratedPlan, adapter, build, built_before, manifest_of, plan_of
from .disturbed import Disturbances
from .exchange import AXES, CYCLE_MS
from .laws import ReferenceTable
from .lead_through.options import Guiding
from .lead_through.study import GuidedBench, guided
from .loop_result import LoopStudy
from .one_run import (
    ELASTIC_HZ,
    FOLLOWING_M,
    LAWS,
    LONGEST_S,
    SLOWER,
    WITH_SERVO,
    Bench,
    OneRun,
    Reference,
    Stop,
    joint_servo,
    lag_of,
    plant_at_start,
    run_of,
    turns,
)
from .plant import PlantSource, Servo
from .predictive_result import PredictiveLoop, goals_of, quantities
from .process import FULL, STATES, LoopError, trajectory_of

LAGS = 1.5  # room for axes that are behind their command, over the lag at constant speed
_ADDRESS = re.compile(r"\d{1,3}(\.\d{1,3}){3}")
# tags of the controller
_SENT = ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_EIPos", "DEF_ESPos", "DEF_Delay")


def rsi_configuration(address: str, port: int) -> str:
    """Return the XML for the KUKA controller: it takes corrections of joints, external axes and pose, with HOLDON="1".

    address, port: of the computer that runs the loop. With HOLDON="0" one late answer would send the robot back to its
    start pose at once; with "1" the robot keeps the last correction. Raises ValueError unless the arguments are an IPv4
    address and a port. This file was not tested on a controller.

    >>> text = gt.loop.rsi_configuration("192.168.1.10", 49152)
    >>> "<IP_NUMBER>192.168.1.10</IP_NUMBER>" in text
    True
    """
    if not _ADDRESS.fullmatch(address) or not 0 < port < 65536:
        raise ValueError(f"'{address}', port {port}: expected an IPv4 address and a port from 1 to 65535")
    lines = ["<ROOT>", "  <CONFIG>", f"    <IP_NUMBER>{address}</IP_NUMBER>", f"    <PORT>{port}</PORT>"]
    lines += ["    <SENTYPE>ImFree</SENTYPE>", "    <ONLYSEND>FALSE</ONLYSEND>", "  </CONFIG>", "  <SEND>"]
    lines.append("    <ELEMENTS>")
    lines += [f'      <ELEMENT TAG="{tag}" TYPE="DOUBLE" INDX="INTERNAL"/>' for tag in _SENT]
    lines += ["    </ELEMENTS>", "  </SEND>", "  <RECEIVE>", "    <ELEMENTS>"]
    tags = [f"RKorr.{c}" for c in "XYZABC"]
    tags += [f"AK.A{n}" for n in range(1, AXES + 1)] + [f"EK.E{n}" for n in range(1, AXES + 1)]
    lines += [f'      <ELEMENT TAG="{tag}" TYPE="DOUBLE" INDX="{n}" HOLDON="1"/>' for n, tag in enumerate(tags, 1)]
    lines += ["    </ELEMENTS>", "  </RECEIVE>", "</ROOT>"]
    return "\n".join(lines) + "\n"


REST_CYCLES = 75  # before, between and after the motions: 0.3 s, enough for a slow drive to come to rest
# friction changes sign on the way back and would push forces over their limits; forces fall with the square of time
BACK = 1.5
_WRITES_ONE = "gtmodel solve --out writes such a motion"


def there_and_back(
    robot: Model, motion: Trajectory, cycles: int, slower: float = 1.0, *, joints: int = 0
) -> ReferenceTable:
    """Return rows q, der(q), der(q,2), T, der(T), der(T,2) every 4 ms for at least `cycles` cycles.

    motion: T, der(T) and der(T,2), or the same of q of an arm with so many `joints`, every 4 ms, from rest to rest;
    stretched to `slower` times its duration. Raises ArgumentError if `reference` is not such a motion, or if the robot
    cannot reach it.
    """
    given, follows, n = ("q", "T", joints) if joints else ("T", "q", 3)
    names, others = ([x, f"der({x})", f"der({x},2)"] for x in (given, follows))
    for name in names:
        if name not in motion.names or motion[name].shape[1:] != (n,):
            raise ArgumentError(f"lacks {name} with {n} components; {_WRITES_ONE}", "reference")
    step = 1e-3 * CYCLE_MS
    if len(motion) < 2 or not np.allclose(np.diff(motion.time), step, rtol=0, atol=1e-9):
        raise ArgumentError(f"must have a row every {step:g} s; {_WRITES_ONE}", "reference")
    outward = np.hstack([motion[name] for name in names])
    if slower != 1.0:
        outward = _back(motion, names, slower)[::-1] * np.repeat([1.0, -1.0, 1.0], n)
    outward[-1, n:] = 0.0
    back = _back(motion, names, BACK * slower)
    begin, end = _resting(outward[0, :n]), _resting(outward[-1, :n])
    rest = (REST_CYCLES, 1)
    period = np.vstack([np.tile(begin, rest), outward, np.tile(end, rest), back])
    rows = np.vstack([np.tile(period, (-(-cycles // len(period)), 1)), np.tile(begin, rest)])
    *following, status = compile_causal(robot, known=given, targets=others)(
        rows[:, :n], rows[:, n : 2 * n], rows[:, 2 * n :]
    )  # fmt: skip
    bad = np.flatnonzero(status != Status.OK)
    if len(bad):
        raise ArgumentError(f"at {step * bad[0]:g} s: {Status(int(status[bad[0]])).message}", "reference")
    return ReferenceTable(np.hstack([rows, *following] if joints else [*following, rows]), CYCLE_MS)


def _resting(place: np.ndarray) -> np.ndarray:
    return np.concatenate([place, np.zeros(2 * len(place))])[None]


def _back(motion: Trajectory, names: list[str], slower: float) -> np.ndarray:
    """Return the motion backwards, `slower` times as long, to its start."""
    place, speed, second = (motion[name] for name in names)
    curve = scipy.interpolate.CubicHermiteSpline(motion.time, place, speed)
    end = float(motion.time[-1])
    times = np.maximum(0.0, end - 1e-3 * CYCLE_MS / slower * np.arange(int(np.ceil(slower * len(motion))) + 1))
    acceleration = [np.interp(times, motion.time, column) for column in second.T]
    rows = np.hstack([curve(times), -curve(times, 1) / slower, np.stack(acceleration, axis=1) / slower**2])
    rows[times <= 0.0] = _resting(place[0])
    rows[0, place.shape[1] :] = 0.0
    return rows


# largest ratio of the tracking errors with and without the law; path correction is slow and only has to help
GAINS = {"trajectory": 0.5, "dynamics": 0.5, "replay": 0.5, "path": 1.0, "predictive": 1.0}
# tolerance between the start of a plant and of its reference: two kinematics may differ by rounding
START_NEAR_M = 1e-6
SYNTHETIC = "the plant is the {}: all measurements are synthetic"


@study_function
def study(
    robot: Model,
    folder: str | Path,
    reference: Reference | None,
    *,
    peer: Literal["egm", "rsi"],
    seconds: Annotated[float, Within(above=0.0, most=LONGEST_S)],
    law: Literal["trajectory", "dynamics", "replay", "path", "lead_through", "predictive"] = "trajectory",
    lead_through: Guiding | None = None,
    disturbances: Disturbances | None = None,
    plant: PlantSource | None = None,
    in_lockstep: bool = False,
    elastic: Annotated[float | None, Within(least=ELASTIC_HZ[0], most=ELASTIC_HZ[1])] = None,
    deceleration: Annotated[float | None, Within(above=0.0)] = None,
    following: Annotated[float | None, Within(above=0.0)] = None,
    built: str | Path | None = None,
    **work_options: Unpack[WorkOptions],
) -> LoopStudy:
    """Build the loop with a generated folder; run it on loopback against a simulated controller, without and with law.

    Args:
        robot: the simulated robot, with three carts [m] or up to six joints [rad] and a position T; the folder was
            generated from its functions. Joints have the laws trajectory and dynamics.
        folder: written by `cgen.study` or gtmodel codegen.
        reference: T, der(T), der(T,2) of carts, or q, der(q), der(q,2) of joints, every 4 ms from rest to rest, or a
            function that returns it, called after the program is built. The robot repeats it there and more slowly
            back. Not used by lead_through.
        peer: egm or rsi.
        seconds: duration of each of the two runs; with `in_lockstep` they go as fast as the machine allows.
        law: trajectory, dynamics, replay or path; the law chooses the plant: drives of eq. (6.11), or the rigid-body
            robot for `dynamics`. lead_through: a hand leads the tool over a synthetic plate, and in the second run a
            sensor fails; the study is a `GuidedLoop`. predictive: the predictive controller of the folder takes the
            reference as its goals, beside computed torque; the study is a `PredictiveLoop`.
        lead_through: settings of that law, with the scene.
        disturbances: delay, noise and further properties of the simulated robot. The law dynamics reads its reference
            earlier by this delay; the controller of the law predictive declares its own.
        plant: replaces the plant that the law chooses, for example a functional mock-up unit, `gt.fmu.PlantUnit`. It
            must start where the reference does; the law dynamics must know the stiffness of its servo. If the plant
            fails on the way, the study has failed and keeps the measurements until then.
        elastic: natural frequency [Hz] of springs between carts and arm, unknown to the laws; None: the arm is rigid.
        deceleration: of the fastest axis when the robot is lost [m/s2, rad/s2], after the held cycles. If None, the
            largest deceleration in the reference, or for lead_through the limit of the law.
        following: largest distance of a cart or joint from its last command [m, rad]; beyond it the loop brakes. Not
            used with the law path, which commands no carts. If None, 0.25; with the drives of eq. (6.11) at least 1.5
            times what they are behind at the reference's greatest speed.
        built: folder of an earlier run; its program is reused if it was built from identical files.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    The study's `files` are the loop's sources, the program, logs and the reference. Raises ArgumentError, and its
    subclass GenerationError if the folder was not generated or does not compile.

    >>> import tempfile
    >>> import numpy as np
    >>> import gtmodel as gt
    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> rest = np.zeros((2, 3))
    >>> units = {"T": "m", "der(T)": "m/s", "der(T,2)": "m/s2"}
    >>> signals = {"T": rest + [0.0, -0.9, 0.1], "der(T)": rest, "der(T,2)": rest}
    >>> reference = gt.Trajectory([0.0, 0.004], signals, units)
    >>> with tempfile.TemporaryDirectory() as place:
    ...     code = gt.cgen.study({"fk": robot.causal(known="q", targets="T")}, place, name="l1", check=None)
    ...     s = gt.loop.study(robot, place, reference, peer="egm", seconds=0.2, in_lockstep=True)
    >>> s.cycles, s.checks["on_running_at_the_end"].passed
    (50, True)
    """
    work = Work(**work_options)
    with naming("robot", ValueError):
        forward = compile_causal(robot, known="q", targets="T")
    joints = forward.inputs[0].shape[0] if turns(forward) else 0
    if forward.outputs[0].shape != (3,) or not (0 < joints <= AXES or forward.inputs[0].shape == (3,)):
        raise ArgumentError("expected a robot with T and three carts, or up to six joints that turn", "robot")
    if joints and law not in ("trajectory", *WITH_SERVO):
        raise ArgumentError(f"the law {law} moves carts; joints have trajectory, dynamics and predictive", "law")
    known = None if plant is None else _known(plant, law, joints or 3)
    if law == "lead_through" and lead_through is None:
        raise ArgumentError("the law lead_through needs its settings: add a table [lead_through] to the problem", "law")
    if law != "lead_through" and reference is None:
        raise ArgumentError(f"the law {law} needs a motion to follow; add one", "reference")
    with scratch("gtmodel-loop-") as place:
        work.progress("building the loop")
        if built is not None:
            built_before(Path(built), place)
        program = build(Path(folder), place, joints or 3, bool(joints))
        planning = _planning(Path(folder), joints or 3, bool(joints)) if law == "predictive" else None
        agreed = None if known is None else _agreed(known.servo, planning)
        cycles = max(1, round(1000 * seconds / CYCLE_MS))
        try:
            if lead_through is not None and law == "lead_through":
                slowing = deceleration or lead_through.gains.acceleration_limit
                guided_bench = GuidedBench(
                    peer,
                    lead_through,
                    robot,
                    forward,
                    program,
                    place,
                    cycles,
                    in_lockstep,
                    elastic,
                    slowing,
                    following or FOLLOWING_M,
                    work,
                )
                outcome = guided(guided_bench, work.title)
            else:
                assert reference is not None
                motion = reference if isinstance(reference, Trajectory) else reference()
                table = there_and_back(robot, motion, cycles, SLOWER.get(law, 1.0), joints=joints)
                (place / "reference.table").write_bytes(table.to_bytes())
                lost = Stop.of(table.rows[:cycles], deceleration)
                if following is None:
                    drives = plant is None and law not in WITH_SERVO
                    behind = lag_of(joints or 3) * lost.speed_m_s if drives else 0.0
                    following = max(FOLLOWING_M, LAGS * behind)
                bench = Bench(
                    peer, law, robot, forward, program, place, table, cycles, in_lockstep, elastic, lost, work, plant,
                    following_m=following, disturbances=disturbances or Disturbances(),
                )  # fmt: skip
                if joints:
                    bench = replace(bench, servo=joint_servo(robot, bench.carts_m[0]))
                if planning is not None:
                    bench = replace(bench, goals=_goals(planning, table, bench.axes), servo=planning.servo)
                if known is not None:
                    _check_start(known, bench)
                    bench = replace(bench, servo=agreed or bench.servo)
                outcome = _compared(bench, _title_of(known, law), work.title, planning)
        except LoopError as error:
            outcome = LoopStudy(status=SolveStatus.FAILED, message=str(error), title=work.title)
        if outcome.status is SolveStatus.INTERRUPTED:
            return outcome
        if known is not None:
            outcome = outcome.with_(notes=[*outcome.notes, SYNTHETIC.format(_title_of(known, law))])
        files = {"rsi_configuration.xml": rsi_configuration("127.0.0.1", 49152)} if peer == "rsi" else {}
        return outcome.with_(files=files | {path.name: path.read_bytes() for path in sorted(place.iterdir())})


# quantities of the stop of carts, and of joints
STOP = (
    ("deceleration", "greatest_speed", "stopping_distance"),
    ("joint_deceleration", "greatest_joint_speed", "stopping_angle"),
)


class PlantStart(NamedTuple):
    """Title, position and servo of a plant at its start."""

    title: str
    position_m: np.ndarray
    servo: Servo | None


def _known(plant: PlantSource, law: str, axes: int) -> PlantStart:
    """Start a plant, read these and release it, as not every unit can run twice at a time. Raises ArgumentError."""
    if law == "lead_through":
        raise ArgumentError("the law lead_through has a plant in its scene; leave this out", "plant")
    first = plant_at_start(plant)
    title = str(getattr(first, "title", type(first).__name__))
    known = PlantStart(title, np.array(first.position_m), getattr(first, "servo", None))
    if len(known.position_m) != axes:
        raise ArgumentError(f"expected {axes} carts; found {len(known.position_m)}", "plant.position")
    if law in WITH_SERVO and known.servo is None:
        raise ArgumentError(
            f"the law {law} needs the stiffness and damping of the servo inside the plant; add them",
            "plant.stiffness",
        )
    return known


def _check_start(known: PlantStart, bench: Bench) -> None:
    """Raise ArgumentError if the plant does not start where the reference does: the first command would jump."""
    reference = bench.carts_m[0]
    distance = np.abs(known.position_m - reference)
    if np.max(distance) > START_NEAR_M:
        start, target = (", ".join(f"{x:.6g}" for x in q) for q in (known.position_m, reference))
        raise ArgumentError(
            f"its carts start at {start} m, the reference at {target} m, {1e3 * np.max(distance):.3g} mm apart: the "
            f"first command would be a jump; change the start values of the plant or the start of the reference",
            "plant.start",
        )


def _agreed(servo: Servo | None, planning: GeneratedPlan | None) -> Servo | None:
    """The servo of a plant. Raises ArgumentError if a predictive controller was made for another one."""
    for name in ("kp_N_m", "kd_N_s_m"):
        if planning is not None and np.any(np.not_equal(getattr(servo, name), getattr(planning.servo, name))):
            key, known = ("stiffness", "kp_N_m") if name == "kp_N_m" else ("damping", "kd_N_s_m")
            made = ", ".join(dict.fromkeys(f"{g:g}" for g in getattr(planning.servo, known)))
            raise ArgumentError(
                f"the servo of the plant has {getattr(servo, name):g}, but the predictive controller was made for "
                f"{made}: give both the same {key}, and generate the folder again", f"plant.{key}",
            )  # fmt: skip
    return servo


def _title_of(known: PlantStart | None, law: str) -> str:
    """Return the name of the plant."""
    if known is None:
        return "rigid body under a servo" if law in WITH_SERVO else "drives of eq. (6.11)"
    return known.title


def _planning(folder: Path, axes: int, joints: bool) -> GeneratedPlan:
    """The predictive controller of a folder, beside what it is compared with. Raises ArgumentError."""
    content = manifest_of(folder)
    plan = plan_of(content, axes)
    if plan is None or plan.period_ms != CYCLE_MS:
        raise ArgumentError(
            f"the folder has no predictive controller with a period of {CYCLE_MS} ms that measures q alone and "
            "commands its servo, which makes tau; add such a table [[predictive]] with servo to the problem", "folder",
        )  # fmt: skip
    if "gt_loop_model_inverse_dynamics" not in adapter(content, axes, joints):
        known = "q" if joints else "T"
        raise ArgumentError(f"computed torque, for comparison, needs a function from {known} to tau; add it", "folder")
    return plan


def _goals(plan: GeneratedPlan, table: ReferenceTable, axes: int) -> ReferenceTable:
    rows = goals_of(plan, table.rows, axes)
    if isinstance(rows, str):
        raise ArgumentError(
            f"a reference has no '{rows}', which the predictive controller takes as a goal", "reference"
        )
    first = 0
    for name, _, size in plan.goals:
        values, first = rows[:, first : first + size], first + size
        low, high = (np.array(side, float) for side in plan.bounds.get(name, ([None], [None])))  # None: nan
        if len(bad := np.argwhere((values < low) | (values > high))):
            k, axis = bad[0]
            raise ArgumentError(
                f"at {1e-3 * table.step_ms * k:g} s its {name} is {values[k, axis]:.4g}, outside the limits that the "
                "predictive controller was given; move the one or the other", "reference",
            )  # fmt: skip
    return ReferenceTable(rows, table.step_ms)


def _compared(bench: Bench, plant: str, title: str, planning: GeneratedPlan | None = None) -> LoopStudy:
    """Make and compare both runs; their logs are in the working folder. Raises LoopError."""
    runs: list[OneRun] = []
    for n, label in enumerate(LAWS[bench.law]):
        bench.work.progress(f"{bench.peer}: {label}", n / 2)
        runs.append(run_of(bench, label, active=n == 1))
        if bench.work.interrupted():
            message = "stopped before both runs were compared"
            return LoopStudy(status=SolveStatus.INTERRUPTED, message=message, title=title)
        if runs[-1].stopped:
            break
    errors = [_errors(bench, one) for one in runs]
    last, checks = runs[-1], dict[str, Check]()
    if not last.stopped:
        plain, active = (e["tcp_rms_mm"] for e in errors)
        checks["rms_error_ratio"] = at_most(active / plain, GAINS[bench.law])
    for name, one in zip(("off", "on"), runs, strict=False):
        log = trajectory_of(
            one.log, bench.axes, 1e-3 * CYCLE_MS, title=f"{bench.peer}, {one.label}: log of the loop",
            unit="rad" if bench.joints else "m", limits=planning.limits if planning and one is runs[-1] else None,
        )  # fmt: skip
        log.to_csv(bench.place / f"loop_{name}.csv")
        state, why = STATES[one.report["state"]], Status(one.report["status"]).message
        if one.report["following_faults"]:
            axis, unit = ("joint", "rad") if bench.joints else ("cart", "m")
            why = f"a {axis} was farther than {bench.following_m:g} {unit} from its last command (following)"
        if not one.stopped:
            checks[f"{name}_running_at_the_end"] = at_least(float(one.going), 1.0, f"{one.label}: {state}, {why}")
        checks[f"{name}_log_complete"] = at_least(float(bool(one.report["log_complete"])), 1.0, FULL)
    real_time_granted = all(one.report["fifo"] and one.report["memory_locked"] for one in runs)
    timing = "in lock step" if bench.in_lockstep else "in real time" if real_time_granted else "not real-time"
    stop = bench.stop
    numbers: dict[str, Any] = dict(
        zip(STOP[bench.joints], (stop.deceleration_m_s2, stop.speed_m_s, stop.distance_m), strict=True)
    )
    message = f"{bench.peer} on loopback, {timing}; tested against simulators only"
    kind: Any = LoopStudy
    if planning is not None and len(runs) == len(LAWS[bench.law]):
        more, judged = quantities(bench, runs, planning)
        kind, numbers, checks = PredictiveLoop, numbers | more, checks | judged
    return kind(
        status=SolveStatus.FAILED if last.stopped else SolveStatus.SOLVED,
        message=f"{last.label}: {last.stopped}" if last.stopped else message,
        title=title,
        checks=checks,
        in_lockstep=bench.in_lockstep,
        notes=list(dict.fromkeys(line for one in runs for line in one.printed.splitlines())),
        peer=bench.peer,
        law=bench.law,
        plant=plant,
        plant_stopped=last.stopped_s,
        elastic=bench.elastic_Hz,
        cycles=bench.cycles,
        real_time=real_time_granted,
        **numbers,
        runs=[{"label": one.label, **e, **one.report} for one, e in zip(runs, errors, strict=True)],
        figures={"tracking": partial(_figure, bench, runs, plant)},
    )


def _errors(bench: Bench, one: OneRun) -> dict[str, float]:
    tcp = 1e3 * np.linalg.norm(one.tcp_m - bench.tcp_m[: len(one.tcp_m)], axis=1)
    carts = 1e3 * np.abs(one.carts_m - bench.carts_m[: len(one.carts_m)])
    return {
        "tcp_rms_mm": float(np.sqrt(np.mean(tcp**2))),
        "tcp_largest_mm": float(tcp.max()),
        "joint_largest_mrad" if bench.joints else "cart_largest_mm": float(carts.max()),
    }


def _figure(bench: Bench, runs: list[OneRun], plant: str) -> Any:
    from ..plot.signals import tracking_figure

    time_s = 1e-3 * CYCLE_MS * np.arange(bench.cycles)
    units = {"T": "m", "q": "rad" if bench.joints else "m"}
    reference = Trajectory(time_s, {"T": bench.tcp_m, "q": bench.carts_m}, units)
    measured = {
        one.label: Trajectory(time_s[: len(one.tcp_m)], {"T": one.tcp_m, "q": one.carts_m}, units) for one in runs
    }
    title = f"{bench.peer.upper()} on loopback, {bench.law}: simulated controller"
    if bench.plant is not None:
        title += f"\n{plant} (synthetic)" + (f", stopped at {runs[-1].stopped_s:.3g} s" if runs[-1].stopped else "")
    return tracking_figure(reference, measured, title)
