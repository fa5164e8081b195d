"""Study of guiding a tool by hand: calibration and test of the sensors, gain limits, a run and its checks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
import scipy

from ..._lazy import hint
from ...geometry.rotations import rotation_by
from ...results import ArgumentError, Check, SolveStatus, Work, at_least, at_most
from ...results.table import csv_text
from ...results.work import WorkOptions, study_function
from ..delayed import gain_limit
from .calibration import WrenchCalibration, calibrate_wrench
from .gains import GuidePhase, Hand, OscillationWatch, SurfaceGains, TurningGains, TurningLaw
from .hand_range import HandStability, hand_stability
from .judgement import TOO_MUCH, aligned, at_the_handle, forces, peg_stiffness
from .law import LeadThroughLaw, SurfaceLaw
from .limits import cone_deviations, simulated_limit
from .options import ConeComparison, GuideSetup, HandRange, LeadThroughStudy, ServoChain, StiffnessRange
from .scenes import SyntheticHole, SyntheticSensor, SyntheticSurface
from .sensor import MountedSensor, SignTest, sign_test
from .tool_run import ToolRun, force_loop, guide_tool

if TYPE_CHECKING:
    from .judgement import PassivityBook
else:
    PassivityBook = hint("gtmodel.control.lead_through", "PassivityBook")

AT_REST = 50  # readings before the start


def calibrated(
    sensor: SyntheticSensor, poses: int, readings: int, turn: np.ndarray, rng: np.random.Generator
) -> tuple[WrenchCalibration, MountedSensor, SignTest]:
    """Calibrate a sensor of the right sign in random poses, averaging `readings` in each, then test its true sign.

    turn (3, 3): of the tool before the start.
    """
    fewer = 1 / np.sqrt(readings)
    right = replace(
        sensor, sign=1.0, force_noise=fewer * sensor.force_noise, moment_noise=fewer * sensor.moment_noise
    )  # fmt: skip
    turns = scipy.spatial.transform.Rotation.random(poses, rng=rng).as_matrix()
    noise = max(right.force_noise, 1e-6), max(right.moment_noise, 1e-8)
    known = calibrate_wrench(turns, *right.readings_at_rest(turns, rng), sigma_force=noise[0], sigma_moment=noise[1])
    axes = turn @ sensor.matrix
    forces = sensor.readings_at_rest(np.tile(axes, (AT_REST, 1, 1)), rng)[0]
    test = sign_test(known, axes, forces, sigma=max(sensor.force_noise, 1e-6))
    return known, MountedSensor.calibrated(known, sensor.matrix, sensor.point), test


SO_FAR = "stopped before the end; the results so far are kept"
AGREES = 0.05  # relative difference of the limits from eigenvalues and from runs
SEEN = 5.0  # times the noise: not reached by noise alone
POINTS = 13  # of the range of stiffnesses
OF_THE_MODE = 0.1  # relative: a pole this close to the servo's mode belongs to it
SURFACE, GAINS, TURNING, SERVO, SETUP = SyntheticSurface(), SurfaceGains(), TurningGains(), ServoChain(), GuideSetup()
WATCH, SENSOR, HANDS = OscillationWatch(level=0.5), SyntheticSensor(), HandRange()


@study_function
def study(
    contact: SyntheticSurface | SyntheticHole,
    phases: Sequence[GuidePhase],
    gains: SurfaceGains = GAINS,
    turning: TurningGains = TURNING,
    *,
    stiffness: StiffnessRange | None = None,
    watch: OscillationWatch = WATCH,
    servo: ServoChain = SERVO,
    handle: SyntheticSensor = SENSOR,
    tool: SyntheticSensor = SENSOR,
    hand: Hand | None = None,
    hands: HandRange | None = HANDS,
    setup: GuideSetup = SETUP,
    cones: ConeComparison | None = None,
    **work_options: Unpack[WorkOptions],
) -> LeadThroughStudy:
    """Guide a tool by hand with two force sensors, against a synthetic contact (Dressler 2012, chapter 8).

    Args:
        contact: a surface, or a hole for a peg; a hole needs gains with `any_direction`.
        phases: actions of the hand. hand: its impedance; without it the hand applies the forces of the phases.
        gains, turning, watch: of the law. stiffness: range of contacts, from which force_gain follows.
        servo: response of the robot. handle, tool: the sensors; both are calibrated and their signs tested first.
        hands: range of impedances for which the loop with a hand must be stable.
        setup: start and requirements. cones: also compare cone widths of (8.10).
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Checks: mean force, losses of contact, loop gain below the limit, agreement of the limits from eigenvalues and runs,
    energy at the handle over any window, stability with a hand; for a peg contact time, depth, tilt and remaining
    torque. Raises ArgumentError if arguments do not fit together.

    >>> L = gt.control.lead_through
    >>> s = L.study(L.SyntheticSurface(), [L.GuidePhase(1.0, force=(0.0, 0.0, -3.0)), L.GuidePhase(
    ...     4.0, force=(5.0, 0.0, -3.0))], hands=None)
    >>> s.status.ok, round(s.limit, 1), s.contact_losses
    (True, 112.1, 0)
    """
    work = Work(**work_options)
    peg = isinstance(contact, SyntheticHole)
    if peg != gains.any_direction:
        raise ArgumentError("must be true for a hole and false for a surface", "gains.any_direction")
    if (turning.by_handle or turning.about_axis == "guide") and not gains.cycle * turning.damping < 2 * turning.inertia:
        least = gains.cycle * turning.damping / 2
        raise ArgumentError(
            f"must be greater than cycle damping / 2, {least:g}, or the guided rotation is unstable", "turning.inertia"
        )
    if peg and stiffness is not None:
        raise ArgumentError("applies only to a surface; for a peg set gains.force_gain", "stiffness")
    work.step("limits")
    limit = gain_limit(force_loop(servo, gains.cycle))
    if stiffness is not None:
        gains = replace(gains, force_gain=stiffness.share * limit.gain / stiffness.stiffest)
    answers: dict[str, Any] = {"force_gain": gains.force_gain, "limit": limit.gain, "frequency": limit.frequency}
    answers |= _loop_gain(contact, gains, turning)
    checks = {"loop_gain_over_limit": Check(
        answers["loop_gain"] / limit.gain, 1.0, "lower the gain: the contact oscillates"
    )} if watch.level == 0.0 else {}  # fmt: skip
    k = contact.stiffness
    ends = (stiffness.softest, stiffness.stiffest) if stiffness else (k / 10, k * 10)
    range_of = np.geomspace(*ends, POINTS)
    answers |= {"stiffnesses": range_of.tolist(), "gain_limits": (limit.gain / range_of).tolist()}
    notes: list[str] = []
    run: ToolRun | None = None
    book: PassivityBook | None = None
    good, files = False, dict[str, str | bytes]()
    title = _synthetic(work.title or "lead-through")

    def answer(status: SolveStatus = SolveStatus.INTERRUPTED) -> LeadThroughStudy:
        message = SO_FAR if status is SolveStatus.INTERRUPTED or run is None else _message(answers, peg, good, run)
        complete_run = run if good else None
        return LeadThroughStudy(
            status=status, message=message, title=title, notes=notes, checks=checks, files=files,
            run=complete_run, book=book,
            figures={} if complete_run is None else
            _figures(complete_run, book, answers, contact, gains, servo, setup, cones, hands, title),
            **answers,
        )  # fmt: skip

    work.keep(answer)
    try:
        simulated, swings = simulated_limit(gains, servo, limit.gain)
    except ArgumentError as error:
        notes.append(f"the limit is from eigenvalues alone: {error}")
    else:
        answers |= {"simulated_limit": simulated, "simulated_frequency": swings}
        checks["limits_apart"] = at_most(
            abs(simulated / limit.gain - 1), AGREES, "runs and eigenvalues differ; change the servo's lag or delay"
        )
    notes += _limit_notes(answers, contact, stiffness, watch) + _noise_notes(gains, tool)
    work.step("run")
    law, run, blind = _run(contact, phases, gains, turning, watch, servo, handle, tool, hand, setup)
    notes += _untested(blind)
    checks["sensors_usable"] = Check(float(run.status), judged=run.allowed, advice=run.status.message)
    if run.stopped is not None:
        notes.append(f"the motion was stopped at {run.stopped:.4g} s and is not evaluated: {run.status.message}")
    if run.allowed:
        book = at_the_handle(run, gains, turning, servo)
        answers |= {"energy_passed": book.passed, "least_window": book.worst, "energy_deficit": book.deficit}
        notes.append(f"energy at the handle: {book}")
        checks["energy_deficit_share"] = at_most(
            book.share, TOO_MUCH, "the robot returns more energy than it stored; raise the damping"
        )
        files["samples.csv"] = _table(run)
        more, remarks, tests = (aligned if peg else forces)(run, contact, law, gains, setup, tool)  # type: ignore[arg-type]
        answers, notes, checks, good = answers | more, notes + remarks, checks | tests, True
    if hands is not None:
        work.step("hands")
        stability = hand_stability(gains, servo, hands, turning, float(np.linalg.norm(setup.grip)))
        answers |= _hand_answers(stability)
        notes.append(_hand_words(stability, hands))
        checks["hand_damping"] = at_least(stability.least, hands.least_damping, _more_damping(stability, servo))
    if cones is not None:
        work.step("cones")
        answers["cone_deviations"] = cone_deviations(gains, servo, cones)
    return answer(SolveStatus.SOLVED)


def _loop_gain(contact: SyntheticSurface | SyntheticHole, gains: SurfaceGains, turning: TurningGains) -> dict[str, Any]:
    if isinstance(contact, SyntheticSurface):
        return {"loop_gain": gains.force_gain * contact.stiffness}
    k = peg_stiffness(contact)
    gain = np.diag([gains.force_gain] * 3 + [turning.torque_gain] * 3)
    _, sizes, directions = np.linalg.svd(k[3:, 3:])
    free = np.array(directions[sizes < 1e-6 * sizes.max()])
    axis = free[0] if len(free) else np.zeros(3)
    return {
        "loop_gain": float(np.abs(np.linalg.eigvals(gain @ k)).max()),
        "undetermined": (np.sign(axis @ [1.0, 1.0, 1.0]) * axis + 0.0).round(9).tolist() if len(free) else None,
    }


def _run(
    contact: SyntheticSurface | SyntheticHole, phases: Sequence[GuidePhase], gains: SurfaceGains, turning: TurningGains,
    watch: OscillationWatch, servo: ServoChain, handle: SyntheticSensor, tool: SyntheticSensor, hand: Hand | None,
    setup: GuideSetup,
) -> tuple[LeadThroughLaw, ToolRun, list[str]]:  # fmt: skip
    """The law, its run, and the sensors whose test cannot detect a rotation about the vertical."""
    rng = np.random.default_rng(setup.seed)
    turn = rotation_by(setup.turn)
    of_tool = calibrated(tool, setup.poses, setup.readings, turn, rng)
    of_handle = calibrated(handle, setup.poses, setup.readings, turn, rng)
    law = LeadThroughLaw(SurfaceLaw(gains, watch=watch), TurningLaw(turning), of_handle[1], of_tool[1])
    run = guide_tool(
        law, phases, contact, servo, handle=handle, tool=tool, tests=(of_tool[2], of_handle[2]), hand=hand,
        grip=setup.grip, start=setup.start, turn=turn, seed=setup.seed + 1,
    )  # fmt: skip
    blind = [name for name, sensor in (("tool", of_tool), ("handle", of_handle)) if sensor[2].blind]
    return law, run, blind


def _hand_answers(hand: HandStability) -> dict[str, Any]:
    worst = {"mass": hand.worst.mass, "damping": hand.worst.damping, "stiffness": hand.worst.stiffness}
    return {
        "hand_damping": hand.least, "hand_mode": hand.frequency, "worst_hand": worst,
        "stiffest_hand": hand.stiffness_limit,
    }  # fmt: skip


def _hand_words(hand: HandStability, hands: HandRange) -> str:
    ranges = (
        f"hands of {hands.mass[0]:g} to {hands.mass[1]:g} kg, {hands.damping[0]:g} to {hands.damping[1]:g} N s/m and "
        f"{hands.stiffness[0]:g} to {hands.stiffness[1]:g} N/m"
    )
    verdict = "stable with all of them" if hand.stable else "unstable with some of them"
    worst = f"{hand.worst.mass:.3g} kg, {hand.worst.damping:.3g} N s/m and {hand.worst.stiffness:.3g} N/m"
    return (
        f"{ranges}: {verdict}; the least damped mode, at {hand.frequency:.3g} Hz with {worst}, has a damping ratio of "
        f"{hand.least:.3g}; stable up to {hand.stiffness_limit:.4g} N/m"
    )


def _more_damping(hand: HandStability, servo: ServoChain) -> str:
    if servo.mode_frequency and abs(hand.frequency / servo.mode_frequency - 1) < OF_THE_MODE:
        return (
            f"the robot's mode at {servo.mode_frequency:g} Hz, with a damping ratio of {servo.mode_damping:g} without "
            "a hand, is poorly damped with a hand on the handle; damp or filter it, or justify a lower "
            "hands.least_damping"
        )
    return "the loop is poorly damped or unstable with a hand in the range; raise gains.mass or gains.damping"


def _untested(blind: Sequence[str]) -> list[str]:
    """A note on sensors tested in one pose."""
    return [
        f"the sign test of {' and '.join(blind)} used one pose, in which a sensor rotated about the vertical reads the "
        "same: before a person holds the handle, test in a second pose, tilted by 30 degrees or more, or push the tool "
        "in a known direction"
    ] if blind else []  # fmt: skip


def _limit_notes(
    answers: dict[str, Any], contact: SyntheticSurface | SyntheticHole, stiffness: StiffnessRange | None,
    watch: OscillationWatch,
) -> list[str]:  # fmt: skip
    notes = []
    share = answers["loop_gain"] / answers["limit"]
    if stiffness is not None and not stiffness.softest <= contact.stiffness <= stiffness.stiffest:
        notes.append(f"the contact of {contact.stiffness:g} N/m lies outside the declared range of stiffnesses")
    if share >= 1:
        reduced = "; the watch then reduces the gain" if watch.level else ""
        notes.append(f"the loop gain is {share:.3g} of its limit: this contact oscillates{reduced}")
    if answers.get("undetermined"):
        x, y, z = answers["undetermined"]
        notes.append(f"the contact does not determine the rotation about the tool's axis ({x:g}, {y:g}, {z:g})")
    return notes


def _noise_notes(gains: SurfaceGains, tool: SyntheticSensor) -> list[str]:
    """Notes on thresholds of contact that noise alone can reach."""
    limits = [(gains.enter_force, tool.force_noise, "N")]
    if gains.any_direction:
        each = float(np.hypot(tool.moment_noise, tool.force_noise * float(np.linalg.norm(tool.point))))
        limits.append((gains.enter_force * gains.contact_arm, each, "N m"))
    return [
        f"contact begins at {limit:.3g} {unit}, below {SEEN:g} times the noise of the tool's sensor: noise can start it"
        for limit, noise, unit in limits
        if limit < SEEN * noise
    ]


def _message(answers: dict[str, Any], peg: bool, good: bool, run: ToolRun) -> str:
    if not good:
        event = "the tool did not move" if run.stopped is None else f"the motion was stopped at {run.stopped:.4g} s"
        return f"{event}: {run.status.message}"
    gain, most, frequency = (f"{answers[name]:.3g}" for name in ("loop_gain", "limit", "frequency"))
    limit = f"loop gain {gain} 1/s, limit {most} 1/s at {frequency} Hz"
    if peg:
        begin, end = np.rad2deg(answers["misalignment"])
        return f"the peg starts {begin:.3g} deg off its hole and ends {end:.3g} deg off; {limit}"
    if answers.get("mean_force") is None:
        return f"the tool did not stay in contact; {limit}"
    return f"mean force {answers['mean_force']:.4g} N, {answers['contact_losses']} losses of contact; {limit}"


def _synthetic(title: str) -> str:
    return title if "synthetic" in title.lower() else f"{title} (synthetic)"


def _table(run: ToolRun) -> str:
    columns: dict[str, Any] = {"time_s": run.time}
    for name, unit, values in (
        ("position", "m", run.position), ("command", "m_s", run.command[:, :3]), ("rate", "rad_s", run.command[:, 3:]),
        ("force", "N", run.force), ("moment", "Nm", run.moment), ("hand_force", "N", run.hand_force),
        ("normal", "1", run.normal),
    ):  # fmt: skip
        columns |= {f"{name}_{axis}_{unit}": values[:, n] for n, axis in enumerate("xyz")}
    return csv_text(columns | {"contact": run.contact.astype(float)}, digits=8, notes=["synthetic"])


def _figures(
    run: ToolRun, book: PassivityBook | None, answers: dict[str, Any], contact: SyntheticSurface | SyntheticHole,
    gains: SurfaceGains, servo: ServoChain, setup: GuideSetup, cones: ConeComparison | None, hands: HandRange | None,
    title: str,
) -> dict[str, Callable[[], Any]]:  # fmt: skip
    """Pictures by name; their curves are computed on drawing."""

    def force() -> Any:
        from ...plot.lead_through import force_figure
        from .judgement import along_normal

        assert isinstance(contact, SyntheticSurface)
        return force_figure(
            run.time, along_normal(run, contact), run.contact, gains.force_reference, gains.cycle, title=title
        )

    def path() -> Any:
        from ...plot.lead_through import path_figure

        return path_figure(run.time, run.position, run.command, run.contact, title=title)

    def energy() -> Any:
        from ...plot.lead_through import energy_figure

        assert book is not None
        return energy_figure(run.time, book.energy, book.stored, book.window, book.worst, title=title)

    def peg() -> Any:
        from ...plot.lead_through import peg_figure
        from .judgement import misaligned

        assert isinstance(contact, SyntheticHole)
        return peg_figure(run.time, run.moment, misaligned(run, contact), run.about, title=title)

    def stability() -> Any:
        from ...plot.lead_through import stability_figure
        from .hand_range import damping_curves

        stiffness = np.geomspace(answers["stiffnesses"][0] / 2, 2 * answers["stiffnesses"][-1], 60)
        k = contact.stiffness
        return stability_figure(
            stiffness, answers["limit"] / stiffness, (k, answers["loop_gain"] / k), gains.force_gain,
            damping_curves(gains, servo, hands) if hands else None, title=title,
        )  # fmt: skip

    def compared() -> Any:
        from ...plot.lead_through import cones_figure

        assert cones is not None
        return cones_figure(np.array(cones.cones), answers["cone_deviations"], title=title)

    drawn: dict[str, Callable[[], Any]] = {"peg": peg} if isinstance(contact, SyntheticHole) else {"force": force}
    drawn |= {"path": path, "energy": energy, "stability": stability}
    return drawn | ({"cones": compared} if cones is not None else {})
