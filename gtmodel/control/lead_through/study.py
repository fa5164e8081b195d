"""Guiding a tool by hand as a study: sensors calibrated and tested before the start, gains within their limits, a
run, and what it shows."""

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
    """Calibrated on random poses while its sign was right, as the law knows it; then its sign is tested.

    In each pose the mean of so many readings counts. turn (3, 3): of the tool before the start.
    """
    fewer = 1 / np.sqrt(readings)
    right = replace(
        sensor, sign=1.0, force_noise=fewer * sensor.force_noise, moment_noise=fewer * sensor.moment_noise
    )  # fmt: skip
    turns = scipy.spatial.transform.Rotation.random(poses, rng=rng).as_matrix()
    noise = max(right.force_noise, 1e-6), max(right.moment_noise, 1e-8)
    known = calibrate_wrench(turns, *right.readings_at_rest(turns, rng), sigma_force=noise[0], sigma_moment=noise[1])
    now = turn @ sensor.matrix
    forces = sensor.readings_at_rest(np.tile(now, (AT_REST, 1, 1)), rng)[0]
    test = sign_test(known, now, forces, sigma=max(sensor.force_noise, 1e-6))
    return known, MountedSensor.calibrated(known, sensor.matrix, sensor.point), test


SO_FAR = "stopped before the end: this is what was found so far"
AGREES = 0.05  # relative: limits by eigenvalues and by runs
SEEN = 5.0  # times the noise: what noise alone does not reach
POINTS = 13  # of the range of stiffnesses
OF_THE_MODE = 0.1  # relative: a pole that near to the servo's mode is it
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
    """Guiding a tool by hand with two force sensors, against a synthetic contact (Dressler 2012, chapter 8).

    Args:
        contact: a surface, or a hole for a peg; for a hole gains have `any_direction`.
        phases: what the hand does. hand: its impedance; without, it presses with the forces of the phases.
        gains, turning, watch: of the law. stiffness: contacts to be met, from which force_gain follows.
        servo: how the robot follows. handle, tool: the sensors; both are calibrated and their signs tested before.
        hands: range of impedances over which the loop with a hand is to be stable.
        setup: where it starts, and what is asked. cones: also compare widths of the cone of (8.10).
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Checks: mean force, losses of contact, loop gains below the limit, limits by eigenvalues and by runs, energy at the
    handle over any window, hands; of a peg its time in contact, its depth, its tilt and the torque that is left. Raises
    ArgumentError for what does not fit.

    >>> L = gt.control.lead_through
    >>> s = L.study(L.SyntheticSurface(), [L.GuidePhase(1.0, force=(0.0, 0.0, -3.0)), L.GuidePhase(
    ...     4.0, force=(5.0, 0.0, -3.0))], hands=None)
    >>> s.status.ok, round(s.limit, 1), s.contact_losses
    (True, 112.1, 0)
    """
    work = Work(**work_options)
    peg = isinstance(contact, SyntheticHole)
    if peg != gains.any_direction:
        said = "a hole wants it" if peg else "a surface has a normal; leave it out"
        raise ArgumentError(f"{said}: the direction of contact", "gains.any_direction")
    if (turning.by_handle or turning.about_axis == "guide") and not gains.cycle * turning.damping < 2 * turning.inertia:
        least = gains.cycle * turning.damping / 2
        raise ArgumentError(
            f"must be greater than cycle damping / 2, {least:g}: else it swings by itself", "turning.inertia"
        )
    if peg and stiffness is not None:
        raise ArgumentError("belongs to a surface; a peg's gain is declared", "stiffness")
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
    shown = _synthetic(work.title or "lead-through")

    def answer(status: SolveStatus = SolveStatus.INTERRUPTED) -> LeadThroughStudy:
        said = SO_FAR if status is SolveStatus.INTERRUPTED or run is None else _message(answers, peg, good, run)
        judged = run if good else None
        return LeadThroughStudy(
            status=status, message=said, title=shown, notes=notes, checks=checks, files=files,
            run=judged, book=book,
            figures={} if judged is None else
            _figures(judged, book, answers, contact, gains, servo, setup, cones, hands, shown),
            **answers,
        )  # fmt: skip

    work.keep(answer)
    try:
        simulated, swings = simulated_limit(gains, servo, limit.gain)
    except ArgumentError as unseen:
        notes.append(f"the limit is by eigenvalues alone: {unseen}")
    else:
        answers |= {"simulated_limit": simulated, "simulated_frequency": swings}
        checks["limits_apart"] = at_most(
            abs(simulated / limit.gain - 1), AGREES, "runs and eigenvalues differ; take other times of the servo"
        )
    notes += _limit_notes(answers, contact, stiffness, watch) + _noise_notes(gains, tool)
    work.step("run")
    law, made, blind = _run(contact, phases, gains, turning, watch, servo, handle, tool, hand, setup)
    notes += _not_seen(blind)
    checks["sensors_usable"] = Check(float(made.status), judged=made.allowed, advice=made.status.message)
    run = made
    if run.stopped is not None:
        notes.append(f"the motion was stopped at {run.stopped:.4g} s, and is not judged: {run.status.message}")
    if run.allowed:
        book = at_the_handle(run, gains, turning, servo)
        answers |= {"energy_passed": book.passed, "least_window": book.worst, "energy_deficit": book.deficit}
        notes.append(f"energy at the handle: {book}")
        checks["energy_deficit_share"] = at_most(
            book.share, TOO_MUCH, "the robot gives more than it stored; raise the damping"
        )
        files["samples.csv"] = _table(run)
        more, said, judged = (aligned if peg else forces)(run, contact, law, gains, setup, tool)  # type: ignore[arg-type]
        answers, notes, checks, good = answers | more, notes + said, checks | judged, True
    if hands is not None:
        work.step("hands")
        seen = hand_stability(gains, servo, hands, turning, float(np.linalg.norm(setup.grip)))
        answers |= _hand_answers(seen)
        notes.append(_hand_words(seen, hands))
        checks["hand_damping"] = at_least(seen.least, hands.least_damping, _more_damping(seen, servo))
    if cones is not None:
        work.step("cones")
        answers["cone_deviations"] = cone_deviations(gains, servo, cones)
    return answer(SolveStatus.SOLVED)


def _loop_gain(contact: SyntheticSurface | SyntheticHole, gains: SurfaceGains, turning: TurningGains) -> dict[str, Any]:
    if isinstance(contact, SyntheticSurface):
        return {"loop_gain": gains.force_gain * contact.stiffness}
    k = peg_stiffness(contact)
    by = np.diag([gains.force_gain] * 3 + [turning.torque_gain] * 3)
    _, sizes, ways = np.linalg.svd(k[3:, 3:])
    free = np.array(ways[sizes < 1e-6 * sizes.max()])
    axis = free[0] if len(free) else np.zeros(3)
    return {
        "loop_gain": float(np.abs(np.linalg.eigvals(by @ k)).max()),
        "undetermined": (np.sign(axis @ [1.0, 1.0, 1.0]) * axis + 0.0).round(9).tolist() if len(free) else None,
    }


def _run(
    contact: SyntheticSurface | SyntheticHole, phases: Sequence[GuidePhase], gains: SurfaceGains, turning: TurningGains,
    watch: OscillationWatch, servo: ServoChain, handle: SyntheticSensor, tool: SyntheticSensor, hand: Hand | None,
    setup: GuideSetup,
) -> tuple[LeadThroughLaw, ToolRun, list[str]]:  # fmt: skip
    """The law, its run, and which sensors were tested in a way that leaves a turn about the vertical unseen."""
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


def _hand_answers(seen: HandStability) -> dict[str, Any]:
    worst = {"mass": seen.worst.mass, "damping": seen.worst.damping, "stiffness": seen.worst.stiffness}
    return {
        "hand_damping": seen.least, "hand_mode": seen.frequency, "worst_hand": worst,
        "stiffest_hand": seen.stiffness_limit,
    }  # fmt: skip


def _hand_words(seen: HandStability, hands: HandRange) -> str:
    asked = (
        f"hands of {hands.mass[0]:g} to {hands.mass[1]:g} kg, {hands.damping[0]:g} to {hands.damping[1]:g} N s/m and "
        f"{hands.stiffness[0]:g} to {hands.stiffness[1]:g} N/m"
    )
    said = "all are stable" if seen.stable else "some are unstable"
    worst = f"{seen.worst.mass:.3g} kg, {seen.worst.damping:.3g} N s/m and {seen.worst.stiffness:.3g} N/m"
    return (
        f"{asked}: {said}; the least damped mode, at {seen.frequency:.3g} Hz with {worst}, has a damping ratio of "
        f"{seen.least:.3g}; stable up to {seen.stiffness_limit:.4g} N/m"
    )


def _more_damping(seen: HandStability, servo: ServoChain) -> str:
    if servo.mode_frequency and abs(seen.frequency / servo.mode_frequency - 1) < OF_THE_MODE:
        return (
            f"the mode of the robot at {servo.mode_frequency:g} Hz, with a damping ratio of {servo.mode_damping:g} by "
            "itself, rings with a hand on the handle; damp or filter it, or declare hands.least_damping and say why"
        )
    return "a hand in the range makes the loop ring or unstable; give it more mass or damping"


def _not_seen(blind: Sequence[str]) -> list[str]:
    """What a test in one pose cannot tell."""
    return [
        f"the sign test of {' and '.join(blind)} saw one pose, where a sensor turned about the vertical reads the "
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
        reduced = "; the gain is reduced when that is seen" if watch.level else ""
        notes.append(f"the loop gain is {share:.3g} of its limit: this contact oscillates{reduced}")
    if answers.get("undetermined"):
        x, y, z = answers["undetermined"]
        notes.append(f"the contact determines no rotation about the axis ({x:g}, {y:g}, {z:g}) of the tool")
    return notes


def _noise_notes(gains: SurfaceGains, tool: SyntheticSensor) -> list[str]:
    """Contact that noise alone begins."""
    limits = [(gains.enter_force, tool.force_noise, "N")]
    if gains.any_direction:
        each = float(np.hypot(tool.moment_noise, tool.force_noise * float(np.linalg.norm(tool.point))))
        limits.append((gains.enter_force * gains.contact_arm, each, "N m"))
    return [
        f"contact begins at {limit:.3g} {unit}, below {SEEN:g} times the noise of the tool's sensor: noise begins it"
        for limit, noise, unit in limits
        if limit < SEEN * noise
    ]


def _message(answers: dict[str, Any], peg: bool, good: bool, run: ToolRun) -> str:
    if not good:
        what = "nothing moved" if run.stopped is None else f"it was stopped at {run.stopped:.4g} s"
        return f"{what}: {run.status.message}"
    own, most, at = (f"{answers[name]:.3g}" for name in ("loop_gain", "limit", "frequency"))
    limit = f"loop gain {own} 1/s, limit {most} 1/s at {at} Hz"
    if peg:
        begin, end = np.rad2deg(answers["misalignment"])
        return f"the peg was {begin:.3g} deg off its hole and ends {end:.3g} deg off; {limit}"
    if answers.get("mean_force") is None:
        return f"the tool did not stay in contact; {limit}"
    return f"{answers['mean_force']:.4g} N held on average, {answers['contact_losses']} losses of contact; {limit}"


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
    """Pictures by name; what they need is computed when they are drawn."""

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

        at = np.geomspace(answers["stiffnesses"][0] / 2, 2 * answers["stiffnesses"][-1], 60)
        k = contact.stiffness
        return stability_figure(
            at, answers["limit"] / at, (k, answers["loop_gain"] / k), gains.force_gain,
            damping_curves(gains, servo, hands) if hands else None, title=title,
        )  # fmt: skip

    def compared() -> Any:
        from ...plot.lead_through import cones_figure

        assert cones is not None
        return cones_figure(np.array(cones.cones), answers["cone_deviations"], title=title)

    drawn: dict[str, Callable[[], Any]] = {"peg": peg} if isinstance(contact, SyntheticHole) else {"force": force}
    drawn |= {"path": path, "energy": energy, "stability": stability}
    return drawn | ({"cones": compared} if cones is not None else {})
