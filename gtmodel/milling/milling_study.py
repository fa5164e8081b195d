"""The milling study: where to mill, from static and dynamic deflection and chatter over the angle about the spindle
axis; and the twelve tests of Cvitanic 2021."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Any, NamedTuple, Unpack

import numpy as np

from ..lang import Model
from ..results import ArgumentError, Check, Row, SolveStatus, Work, at_least, at_most
from ..results.options import Long, Within
from ..results.work import WorkOptions, study_function
from .angle_search import AngleSearch, search as search_angles
from .chatter import Lobes, critical_depth, mode_coupling, stability_lobes
from .compensation import FILE, compensated
from .cutter import Cut, Cutter, CuttingCoefficients
from .deflection import SECONDS, deflections
from .options import MillingSearch, MillingStudy, MillingTool, PathOffset
from .oscillators import Oscillators, missing_z
from .pose_dynamics import Given, runs_of
from .stability import spectral_radius
from .task import MillingTask, deflections_of, place_of, task_of

FEEDS = {"+x": (1.0, 0.0, 0.0), "+y": (0.0, 1.0, 0.0)}
BEATS = 1.5  # ratio of mean deflections from which the dynamic choice counts as better
TIE_MM = 0.06
MISSED = 0.6  # share of the measured mean: lower predictions count as misses
NOTE = (
    "c_z is missing in Table 16: its damping ratio is taken as the mean of x and y; the feed direction is not printed, "
    "so both are shown; which fits better depends on test 5 (+x without it, +y with it), found after the comparison"
)


class PrintedTests(NamedTuple):
    """Tests 1 to 12: tooth frequency [Hz], predicted mean deflection by feed and measured mean deflection [mm] (NaN:
    not printed), spectral radius of the linear model and critical depth by feed, and the model that chose the pose."""

    tooth_hz: np.ndarray
    mean_mm: dict[str, np.ndarray]
    measured_mean_mm: np.ndarray
    radius: dict[str, np.ndarray]
    depth_mm: dict[str, np.ndarray]
    chosen_by: list[str]


def printed_tests(tables: Mapping[str, Any]) -> PrintedTests:
    """Predict the tests from the printed oscillators and cutting coefficients; tables: `robots.kr500_tables()`."""
    c, t = tables["cutting"], tables["milling_tests"]
    names = ("K_te_N_m", "K_tc_Pa", "K_re_N_m", "K_rc_Pa", "K_ae_N_m", "K_ac_Pa")
    cutter = Cutter(
        c["diameter_m"], c["teeth"], CuttingCoefficients(*(c[k] for k in names)), np.deg2rad(c["helix_deg"])
    )
    cut = Cut(c["mode"], c["radial_depth_m"], c["axial_depth_m"], c["feed_per_tooth_m"])
    hz = np.array(t["tooth_frequency_Hz"])
    o = missing_z(t["m_kg"], t["c_N_s_m"], 1e6 * np.array(t["k_MN_m"]))
    mean, radius, depth = {}, {}, {}
    for name, feed in FEEDS.items():
        runs = [deflections(o[i], cutter, cut, f / cutter.teeth, feed) for i, f in enumerate(hz)]
        mean[name] = 1e3 * np.array([d.mean[0] for d in runs])
        radius[name] = np.array([spectral_radius(o[i], cutter, cut, f / cutter.teeth, feed) for i, f in enumerate(hz)])
        depth[name] = 1e3 * np.array([critical_depth(o[i], cutter, cut, feed) for i in range(len(hz))])
    measured = np.pad(t["deflection_mean_mm"], (0, 2), constant_values=np.nan)
    return PrintedTests(hz, mean, measured, radius, depth, t["optimised_with"])


def rows(p: PrintedTests) -> list[Row]:
    """Return the predictions next to the measurements, and the verdicts."""
    rows_of_tests = []
    for i, hz in enumerate(p.tooth_hz):
        measured = "not printed" if np.isnan(p.measured_mean_mm[i]) else f"{p.measured_mean_mm[i]:.2f}"
        predicted = ", ".join(f"{name} {mean[i]:.2f}" for name, mean in p.mean_mm.items())
        label = f"test {i + 1}, {hz:g} Hz, {p.chosen_by[i]}: mean"
        rows_of_tests.append(Row(label, f"{predicted}; measured {measured}", "mm"))
    return [*rows_of_tests, *(Row("printed tests", sentence) for sentence in [*verdicts(p), NOTE])]


def verdicts(p: PrintedTests) -> list[str]:
    """Return sentences on the tests that the predictions explain or miss."""
    sentences = []
    for name, mean in p.mean_mm.items():
        pairs = [f"{p.tooth_hz[i]:g} Hz: {mean[i]:.2f} against {mean[i + 1]:.2f} mm" for i in range(0, 8, 2)]
        sentences.append(f"feed {name}, static against dynamic choice, {'; '.join(pairs)}")
    best = np.max(list(p.mean_mm.values()), axis=0)
    missed = [i for i in range(10) if best[i] < MISSED * p.measured_mean_mm[i]]
    for i in missed:
        radius = ", ".join(f"{r[i]:.2f} ({name})" for name, r in p.radius.items())
        depth = p.depth_mm["+x"][i]
        sentences.append(
            f"test {i + 1} is missed: {best[i]:.2f} mm at most, measured {p.measured_mean_mm[i]:.2f}; with feed +x the "
            f"linear model of these poses is unstable by mode coupling from a depth of {depth:.2g} mm on, spectral "
            f"radius with regeneration {radius}: chatter is one explanation, which the thesis rules out"
        )
    return sentences


def checks(p: PrintedTests) -> dict[str, Check]:
    """Check what the printed oscillators support: a tie far from a mode, the dynamic choice near one."""
    ratios = [mean[i] / mean[i + 1] for mean in p.mean_mm.values() for i in (0, 4)]
    ties = [abs(mean[i] - mean[i + 1]) for mean in p.mean_mm.values() for i in (2, 6)]
    return {
        "static_over_dynamic_near_a_mode": at_least(float(min(ratios)), BEATS),
        "difference_far_from_a_mode_mm": at_most(float(max(ties)), TIE_MM),
    }


SPEEDS = 121  # of the picture of the lobes


def angle(f: AngleSearch) -> Any:
    """Draw both indices over the angle."""
    from ..plot.milling import angle_figure

    place, n = f.place, len(f.place.sweep.angles)
    frequency, peak, marks = np.full((n, 3), np.nan), np.full(n, np.nan), {}
    if place.dynamics is not None and f.findings is not None:
        frequency[place.dynamics.rows] = place.dynamics.oscillators.frequency
        peak = f.peak
        static = "declared static choice" if f.findings.static_row is not None else "static choice"
        marks = {static: place.sweep.angles[f.findings.choices[0]], "dynamic choice": f.angle}
    else:
        marks = {"static choice": place.sweep.angles[int(np.nanargmin(place.static))]}
    tooth = [f.task.speed * f.task.cutter.teeth * n for n in range(1, 6)]
    return angle_figure(place.sweep.angles, place.static, peak, frequency, tooth, reachable=place.sweep.reachable,
                        choices=marks, title=f.task.heading)  # fmt: skip


def tests_figure(p: PrintedTests) -> Any:
    """Draw predictions next to measurements."""
    from ..plot.milling import tests_figure

    title = "Tests of Cvitanic 2021: predicted from Table 16, measured in Table 5"
    return tests_figure(p.tooth_hz, p.mean_mm, p.measured_mean_mm, p.chosen_by, title=title)


def lobes_of(task: MillingTask, lobes: Lobes, low: float, high: float) -> Any:
    """Draw stability over the declared speeds."""
    from ..plot.milling import lobes_figure

    speed = np.linspace(low, high, SPEEDS)
    title = f"{task.heading}: proven stable axial depth"
    return lobes_figure(speed, lobes.depth_at(speed), (task.speed, task.cut.axial_depth), title=title)


Array = np.ndarray
SHALLOWER = "the cut chatters: take less depth or another speed"
DECAYED = 0.05  # share of a transient that is not reported


@study_function
def study(
    robot: Model,
    cutter: Cutter,
    cut: Cut,
    *,
    place: Annotated[Sequence[float], Long(3)],
    speed: Annotated[float, Within(above=0.0)],
    joint_stiffness: Annotated[Sequence[float], Long(6), Within(above=0.0)],
    feed: Annotated[Sequence[float], Long(3)] = (1.0, 0.0, 0.0),
    tool: MillingTool | None = None,
    dynamics: Given | None = None,
    source: str = "",
    limits: Annotated[Sequence[Sequence[float]] | None, Long(2)] = None,
    search: MillingSearch | None = None,
    lobes: Annotated[tuple[float, float] | None, Within(above=0.0)] = None,
    compensation: PathOffset | None = None,
    tests: Mapping[str, Any] | None = None,
    **work_options: Unpack[WorkOptions],
) -> MillingStudy:
    """Find where to mill: reachable angles about the spindle, their static and dynamic index, the best angle, and
    recommendations.

    Args:
        robot: a serial arm with a spherical wrist.
        cutter, cut: the tool and its engagement.
        place: (3,) tool centre point [m], world coordinates.
        speed: of the spindle [1/s].
        joint_stiffness: (6,) by joint [N.m/rad], for the static index.
        feed: (3,) direction perpendicular to the tool axis, world coordinates.
        tool: mounting on the flange, and direction over the work.
        dynamics: `AngleTable` of oscillators measured at angles, `Modal` masses on the joint stiffness, or an
            `OscillatorField` over the poses; default: static index only.
        source: name of the source of the dynamics, such as a file.
        limits: (6, 2) of the joints [rad]; default: those of the robot.
        search: grid of the angle; places, feeds and speeds to compare; refinement.
        lobes: lowest and highest speed [1/s] of stability lobes in the chosen pose.
        compensation: a path offset against the deflection in the chosen pose.
        tests: tables of milling tests to predict, such as `gtmodel.robots.kr500_tables()`.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    An interrupted study has the results that need only the stiffness, or no values if these were not complete. Raises
    ArgumentError.

    >>> import numpy as np
    >>> import gtmodel as gt
    >>> from gtmodel.milling import Cut, Cutter, CuttingCoefficients, MillingSearch, study
    >>> cutter = Cutter(0.0254, 2, CuttingCoefficients(6.1e3, 9.0e8, 6.6e3, 2.9e8, 1.1e3, 2.8e8))
    >>> k = 1e6 * np.array([3.93, 3.46, 2.77, 1.57, 0.24, 0.17])
    >>> s = study(gt.robots.kr500(), cutter, Cut("slot", 0.0254, 0.005, 5e-4), place=[0.0, -2.4, 0.3], speed=30.0,
    ...           joint_stiffness=k, search=MillingSearch(step=0.2))
    >>> round(1e3 * s.static_index, 2)  # [mm]
    2.13
    """
    work = Work(**work_options)
    work.step("checking inputs", 0.1)
    task = task_of(
        robot, cutter, cut, place=place, speed=speed, feed=feed, joint_stiffness=joint_stiffness, dynamics=dynamics,
        tool=tool or MillingTool(), search=search or MillingSearch(), limits=limits, source=source, title=work.title,
    )  # fmt: skip
    if dynamics is None and (lobes or compensation):
        raise ArgumentError("needs dynamics; add dynamics, or leave it out", "lobes" if lobes else "compensation")
    if lobes is not None and lobes[0] >= lobes[1]:
        message = f"is {60 * lobes[1]:g} rpm; expected more than the lower end, {60 * lobes[0]:g}"
        raise ArgumentError(message, "lobes")
    work.step("computing the static index", 0.2)
    angle_search = AngleSearch(task, place_of(task, task.place))
    if work.interrupted():
        return _outcome(angle_search, None, None, None, "stopped before the search")
    if angle_search.place.dynamics is not None:
        search_angles(work, angle_search)
    if work.interrupted():
        return _outcome(AngleSearch(task, angle_search.place), None, None, None, "stopped in the search")
    return _outcome(angle_search, lobes, compensation, tests)


def _outcome(
    f: AngleSearch, lobes: tuple[float, float] | None, compensation: PathOffset | None, tests: Mapping[str, Any] | None,
    stopped: str = "",
) -> MillingStudy:  # fmt: skip
    """Return the study; `stopped`: message of an interrupted study, which has only results from the stiffness."""
    task, place = f.task, f.place
    angles = place.sweep.angles
    best = int(np.nanargmin(place.static))
    runs = angles[runs_of(place.sweep.reachable)]
    values: dict[str, Any] = {
        "reachable": runs,
        "static_angle": float(angles[best]),
        "static_index": float(place.static[best]),
        "dynamics": task.whence,
    }
    table = [
        Row("reachable angles", ", ".join(_degrees(*run) for run in runs), "deg"),
        Row("least static index (18)", f"{1e3 * place.static[best]:.3g} at {np.rad2deg(angles[best]):.4g} deg", "mm"),
    ]
    tested: dict[str, Check] = {}
    figures: dict[str, Any] = {"angle": partial(angle, f)}
    files: dict[str, str | bytes] = {}
    if place.dynamics is not None and f.findings is not None:
        quantities, more, checked = _dynamic(f)
        values |= quantities
        table += more
        tested |= checked
        chosen = place.dynamics.at(f.angle)
        if lobes is not None:
            limits = stability_lobes(chosen, task.cutter, task.cut.mode, task.cut.radial_depth, task.feed, up=task.up)
            depth = float(limits.depth_at([task.speed])[0])
            text = f"{1e3 * depth:.3g}" if np.isfinite(depth) else "no limit below 1000"
            table.append(Row("proven stable depth at this speed", text, "mm"))
            figures["lobes"] = partial(lobes_of, task, limits, *lobes)
        if compensation is not None:
            offset = compensated(task, chosen, compensation)
            values["compensation_rms"] = offset.rms
            tested["compensated_rms_mm"] = offset.check
            table += offset.rows
            files[FILE] = offset.file
            figures["compensation"] = partial(offset.figure, task.heading)
    if tests is not None:
        printed = printed_tests(tests)
        table += rows(printed)
        tested |= checks(printed)
        values["printed_mean"] = {name: mean.tolist() for name, mean in printed.mean_mm.items()}
        figures["printed_tests"] = partial(tests_figure, printed)
    return MillingStudy(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message=stopped or f"{int(place.sweep.reachable.sum())} of {len(angles)} angles reachable",
        title=task.title,
        objective=None if np.isnan(f.index) else 1e3 * f.index,
        checks=tested,
        figures=figures,
        files=files,
        machine_files=(FILE,),
        table=table,
        **values,
    )


def _dynamic(f: AngleSearch) -> tuple[dict[str, Any], list[Row], dict[str, Check]]:
    """Return the values, rows and checks from the dynamics."""
    task, findings, dynamics = f.task, f.findings, f.place.dynamics
    assert findings is not None and dynamics is not None
    s_row, _ = findings.choices
    oscillators = dynamics.at(f.angle)
    deflection = deflections_of(task, oscillators)
    coupling = mode_coupling(oscillators, task.cutter, task.cut, task.feed, up=task.up)
    tested: dict[str, Check] = {}
    try:
        radius = spectral_radius(oscillators, task.cutter, task.cut, task.speed, task.feed, up=task.up)
        chatter = f"{'none' if radius < 1 else 'expected'}: spectral radius {radius:.3f}"
        # at exactly 1 a vibration does not decay
        tested["spectral_radius"] = at_most(radius, float(np.nextafter(1.0, 0.0)), SHALLOWER)
    except ValueError as error:
        radius, chatter = None, f"unknown: {error}"
    if task.cutter.runout is not None:
        chatter += "; the declared runout is not included"
    freed = f.freed and [np.rad2deg(f.freed.angle), 60 * f.freed.speed, 1e3 * f.freed.peak]
    values = {
        "static_choice": float(findings.angles[s_row]),
        "dynamic_angle": f.angle,
        "dynamic_index": f.index,
        "dynamic_mean": float(deflection.mean[0]),
        "static_choice_index": float(f.peak[s_row]),
        "ratio": findings.ratio,
        "refined": [[np.rad2deg(b.angle), 1e3 * b.peak, b.converged] for b in f.refined],
        "free_speed": freed,
        "combinations": f.combinations,
        "change_1_Hz": [100 * x for x in findings.change],
        "mode_coupling": coupling.message,
        "spectral_radius": radius,
        "guideline": f.guideline,
    }
    table = [
        Row("static choice", f"{np.rad2deg(findings.angles[s_row]):.4g}, {_whence(f)}", "deg"),
        Row("least dynamic index (19)", f"{1e3 * f.index:.3g} at {np.rad2deg(f.angle):.4g} deg", "mm"),
        Row("mean deflection there", 1e3 * deflection.mean[0], "mm"),
        *_transients(oscillators),
    ]
    if freed:
        table.append(Row("with free speed", f"{freed[2]:.3g} at {freed[0]:.4g} deg and {freed[1]:.4g} rpm", "mm"))
    table += [
        *(Row("guideline", sentence) for sentence in f.guideline),
        Row("mode coupling", coupling.message),
        Row("regenerative chatter", chatter),
        Row("dynamics", task.whence),
        *_known(findings.angles, f),
        *(Row(*_combined(c)) for c in f.combinations if len(f.combinations) > 1),
    ]
    return values, table, tested


def _transients(oscillators: Oscillators) -> list[Row]:
    """Return a remark if two seconds from rest are too short for the steady deflection."""
    rate = (np.pi * 2 * oscillators.frequency * oscillators.damping_ratio)[0]
    axis = int(np.argmin(rate))
    remainder = float(np.exp(-rate[axis] * SECONDS))
    if remainder < DECAYED:
        return []
    share = f"after {SECONDS:g} s {100 * remainder:.0f} % of the transient along {'xyz'[axis]} remain"
    return [Row("not steady", f"{share}: near a mode deflections may grow beyond the index and the mean")]


def _known(angles: Array, f: AngleSearch) -> list[Row]:
    """Return the angles with known dynamics, unless all reachable angles have them."""
    known = np.isfinite(f.peak)
    if known.sum() == f.place.sweep.reachable.sum():
        return []
    runs = ", ".join(_degrees(*run) for run in angles[runs_of(known)])
    return [Row("angles with known dynamics", f"{runs}; other reachable angles have only a static index", "deg")]


def _whence(f: AngleSearch) -> str:
    if f.task.search.static_choice is not None:
        return "declared"
    known = np.isfinite(f.peak[np.nanargmin(f.place.static)])
    return "least static index" + ("" if known else " among angles with dynamics")


def _combined(c: Mapping[str, Any]) -> tuple[str, str, str]:
    place = ", ".join(f"{x:.4g}" for x in c["place_m"])
    if "reason" in c:
        return f"at ({place}) m", c["reason"], ""
    feed = ", ".join(f"{x:g}" for x in c["feed_direction"])
    label = f"{c['speed_rpm']:.5g} rpm, feed ({feed}), at ({place}) m"
    return label, f"{c['index_mm']:.3g} at {c['angle_deg']:.4g} deg", "mm"


def _degrees(low: float, high: float) -> str:
    return f"{np.rad2deg(low):.4g} to {np.rad2deg(high):.4g}"
