"""Joint stiffness of a serial arm from static load tests: kind "calibration" with the table [joint_stiffness]."""

from __future__ import annotations

from typing import Any

import numpy as np
import tomli_w

from gtmodel.compliance import (
    StiffnessFit,
    complete_pose,
    decoupled,
    select,
    softest_and_stiffest,
    translational_compliance,
    with_compensator,
)
from gtmodel.compliance.compensated import RATE
from gtmodel.inference import FALSE_ALARM
from gtmodel.measurements import copies
from gtmodel.problem_files.base import Context, InputError, Outcome, Row, at_least, at_most
from gtmodel.problem_files.sentences import listed
from gtmodel.results import SolveStatus

from . import calibration_stiffness_report
from .calibration_keys import Schema
from .calibration_stiffness_data import FILE, KEY, LoadTestData, data_of
from .calibration_stiffness_doubts import negative, repeated
from .calibration_stiffness_keys import JointStiffness

VALUES = (
    "with [joint_stiffness]: method, stiffness_MNm_rad with interval_MNm_rad (95 %; null: no upper end) and "
    "compliance_rad_Nm by joint, other_method_MNm_rad and agree (whether intervals overlap), compensator_rate_N_m and "
    "its std, chi_squared_p, adequacy and adequate, observability_O1, told, best_tests (lines of the file), "
    "softest_N_m and stiffest_N_m by test (null for a negative compliance), said: doubts about the tests, and what the "
    "print claims and the model does not support; all other values but synthetic are then null"
)
WITHIN = 0.1  # of synthetic tests: largest relative error of a compliance
ALIKE = ("kind", "title", "robot", "parameters", "joint_stiffness")
# printed claims (Cvitanic 2021, section 3.2) beside what follows from the model
PRINTED = (
    "without model error both methods give the same stiffness: the print's softer decoupled values (Tables 1 and 2) do "
    "not follow from it",
    "weighting rotations by 10 repairs nothing: it widens the intervals, and in the print even raises joint 4",
)
LACKS = (
    "the residuals are larger than the stated noise: links or bearings give way too, and the stiffness of the joints "
    "then takes up some of what they do"
)
MOMENT = "the arm's torque holds the moment of the load about the wrist centre, which the print leaves out"
SAID = (*PRINTED, MOMENT)


def solve(problem: Schema, context: Context) -> Outcome:
    """Jacobians from the robot's equations, then both methods."""
    keys = _keys(problem)
    context.progress("kinematics", 0.1)
    data = data_of(keys, problem.model(context), context)
    if context.interrupted():
        return Outcome(status=SolveStatus.INTERRUPTED, message="stopped before the fit")
    try:
        fits = _fits(keys, data)
        fit = fits[keys.method]
        best = select(data.tests, min(keys.best, len(data.tests.J)), fit.compliance).chosen
    except InputError:
        raise
    except ValueError as error:
        at = "load" if keys.measurements is None else "measurements.file"
        raise InputError(str(error), f"{KEY}.{at}") from error
    return _outcome(problem, keys, data, fits, best, context)


def explain(problem: Schema, context: Context) -> str:
    """What will be fitted to how many rows."""
    data = data_of(_keys(problem), problem.model(context), context)
    n = len(data.tests.J)
    return "\n".join(
        [
            f"{problem.title or KEY}: {n} static load tests",
            "dX = J diag(J'F) c with c = 1/K, linear in the compliances (Cvitanic 2021, eqs. (2), (3), (6))",
            f"complete pose: {6 * n} rows; decoupled: {3 * n} rows of the wrist centre, then {3 * n} of the tool",
            *PRINTED,
        ]
    )


def _keys(problem: Schema) -> JointStiffness:
    keys = problem.joint_stiffness
    assert keys is not None
    beside = sorted(problem.model_fields_set - set(ALIKE))
    if beside:
        raise InputError(f"is of a geometric calibration; leave it out beside [{KEY}]", beside[0])
    return keys


def _fits(keys: JointStiffness, data: LoadTestData) -> dict[str, StiffnessFit]:
    if keys.compensator is None or not keys.compensator.estimate_rate:
        return {"complete_pose": complete_pose(data.tests), "decoupled": decoupled(data.tests)}
    if keys.method == "decoupled":
        raise InputError("estimates no compensator; use complete_pose", f"{KEY}.method")
    K_c = data.tests.K_c
    assert data.spring is not None and K_c is not None
    loads = K_c - data.spring.added(np.zeros_like(K_c), data.poses.q)
    return {"complete_pose": with_compensator(data.tests.with_(K_c=loads), data.spring, data.poses.q)}


def _outcome(
    problem: Schema, keys: JointStiffness, data: LoadTestData, fits: dict[str, StiffnessFit], best: tuple[int, ...],
    context: Context,
) -> Outcome:  # fmt: skip
    from .calibration_results import VALUES as GEOMETRIC

    fit = fits[keys.method]
    v = _values(keys, data, fits, best)
    title = problem.title or f"joint stiffness of {problem.robot}"
    note = data.synthetic
    if note and "synthetic" not in title.lower():
        title += " (synthetic)"
    values: dict[str, Any] = {**dict.fromkeys(GEOMETRIC), "synthetic": note, "joint_stiffness": v}
    # noise that was stated too large makes intervals wide, not wrong
    small = fit.adequacy.statistic <= fit.estimate.freedom
    least = min(FALSE_ALARM, fit.adequacy.p) if small else FALSE_ALARM
    checks = {"chi_squared_p": at_least(fit.adequacy.p, least, "the notes say what the residuals may hold")}
    again = copies(np.column_stack([data.poses.q, data.tests.wrench, data.tests.displacement]))
    if len(again):
        checks["copied_tests"] = at_most(float(len(again)), 0.0, "take copies out")
    below = int(np.sum(fit.compliance <= 0))
    if below:
        checks["negative_compliances"] = at_most(float(below), 0.0, "the notes name the joints")
    if keys.synthetic is not None:
        true = 1e-6 / np.array(keys.synthetic.stiffness_MNm_rad)
        errors = np.abs(fit.compliance / true - 1)
        from scipy.stats import norm  # here: it alone takes as long to import as all of gtmodel

        # a compensator's constant may stand behind the joints
        std = np.sqrt(np.diag(fit.estimate.covariance))[: len(true)]
        chance = norm.isf(FALSE_ALARM / 2 / len(true)) * std / true
        bounds = np.maximum(WITHIN, chance)
        worst = int(np.argmax(errors / bounds))
        checks["compliance_error"] = at_most(float(errors[worst]), float(bounds[worst]))
    comment = f"# synthetic: {note}\n" if note else ""
    figures = {"stiffness": lambda: _figure(keys, fits, title, note)}
    files = {
        "parameters.toml": comment + tomli_w.dumps({"stiffness_MNm_rad": v["stiffness_MNm_rad"]}),
        "report.html": calibration_stiffness_report.text(values, figures, title, problem.robot, context),
    }
    if data.text is not None:
        files[FILE] = data.text
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{len(data.tests.J)} tests, {fit.method}",
        objective=float(0.5 * fit.estimate.residuals @ fit.estimate.residuals),
        checks=checks,
        values=values,
        rows=_rows(v, fit, note),
        figures=figures,
        files=files,
        machine_files=("parameters.toml",),
    )


def _values(
    keys: JointStiffness, data: LoadTestData, fits: dict[str, StiffnessFit], best: tuple[int, ...]
) -> dict[str, Any]:
    fit = fits[keys.method]
    other = next((f for name, f in fits.items() if name != keys.method), None)
    joints = range(len(fit.compliance))
    intervals = [np.array(fit.interval(j)) / 1e6 for j in joints]
    # a negative compliance leaves no direction a stiffness: null, not infinite
    sound = bool(np.all(fit.compliance > 0))
    stiffness, _ = softest_and_stiffest(translational_compliance(data.poses.J, fit.compliance))
    doubts = [s for f in (fit, other) if f is not None for s in negative(f)]
    doubts += repeated(data.tests, data.poses.q, data.lines)
    rate = None
    if RATE in fit.estimate.names:
        at = fit.estimate.names.index(RATE)
        rate = [float(fit.estimate.values[at]), float(fit.estimate.std[at])]
    return {
        "method": fit.method,
        "stiffness_MNm_rad": (fit.stiffness / 1e6).tolist(),
        "interval_MNm_rad": [[x if np.isfinite(x) else None for x in i.tolist()] for i in intervals],
        "compliance_rad_Nm": fit.compliance.tolist(),
        "other_method_MNm_rad": None if other is None else (other.stiffness / 1e6).tolist(),
        "agree": None if other is None else [_overlap(fit.interval(j), other.interval(j)) for j in joints],
        "compensator_rate_N_m": rate,
        "chi_squared_p": fit.adequacy.p,
        "adequacy": fit.adequacy.sentence,
        "adequate": bool(fit.adequacy.passed),
        "observability_O1": fit.told.indices.o1,
        "told": fit.told.sentences(),
        "best_tests": [int(data.lines[i]) for i in best],
        "softest_N_m": stiffness[:, 0].tolist() if sound else None,
        "stiffest_N_m": stiffness[:, -1].tolist() if sound else None,
        "said": [*doubts, *([] if fit.adequacy.passed else [LACKS]), *PRINTED, MOMENT],
    }


def _rows(v: dict[str, Any], fit: StiffnessFit, note: str | None) -> list[Row]:
    rows = [
        Row(f"joint {j + 1}", f"{K:.4g} {_range(i)}", "MN.m/rad")
        for j, (K, i) in enumerate(zip(v["stiffness_MNm_rad"], v["interval_MNm_rad"], strict=True))
    ]
    if v["other_method_MNm_rad"] is not None:
        rows.append(Row("by the other method", listed(v["other_method_MNm_rad"]), "MN.m/rad"))
        rows.append(Row("their intervals overlap", ", ".join("yes" if a else "no" for a in v["agree"])))
    if v["compensator_rate_N_m"] is not None:
        rate, std = v["compensator_rate_N_m"]
        rows.append(Row("rate of the gravity compensator", f"{rate:.4g} (std {std:.2g})", "N/m"))
    rows += [
        Row("residuals", fit.adequacy.sentence),
        *([] if v["softest_N_m"] is None else [
            Row("softest direction of the tool, over the tests", f"{min(v['softest_N_m']) / 1e6:.4g} to "
                f"{max(v['softest_N_m']) / 1e6:.4g}", "N/um")]),
        Row("tests that tell most, lines of the file", ", ".join(map(str, v["best_tests"]))),
        *(Row("told", sentence) for sentence in v["told"]),
        *(Row("beside the print" if sentence in SAID else "look at this", sentence) for sentence in v["said"]),
    ]  # fmt: skip
    return [*rows, Row("SYNTHETIC", note)] if note else rows


def _range(ends: list[float | None]) -> str:
    low, high = ends
    if low is None:
        return "(negative, no interval)"
    return f"({low:.4g} .. {'no end' if high is None else f'{high:.4g}'})"


def _figure(keys: JointStiffness, fits: dict[str, StiffnessFit], title: str, note: str | None) -> Any:
    from gtmodel.plot.stiffness import stiffness_figure

    found = [(f.method, f.stiffness, np.array([f.interval(j) for j in range(len(f.stiffness))])) for f in fits.values()]
    true = None if keys.synthetic is None else 1e6 * np.array(keys.synthetic.stiffness_MNm_rad)
    return stiffness_figure(found, true, title=f"{title}\n(synthetic: {note})" if note else title)


def _overlap(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return max(a[0], b[0]) <= min(a[1], b[1])
