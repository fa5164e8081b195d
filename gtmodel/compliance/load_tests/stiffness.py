"""The stiffness study: joint stiffness of a serial arm from static load tests, by both methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Unpack

import numpy as np

from ...inference import FALSE_ALARM
from ...lang import Model
from ...measurements.inspection.data_tests import Data, tested
from ...results import ArgumentError, Check, Quantity, Row, SolveStatus, Study, Work, at_least, at_most, listed
from ...results.estimate import half_width
from ...results.suspicion import suspicion_checks
from ...results.work import WorkOptions, study_function
from ..cartesian import softest_and_stiffest, translational_compliance
from ..joint_stiffness import RATE, StiffnessFit, complete_pose, decoupled, select, stiffness_names, with_compensator
from ..static_tests import StaticTests
from .options import Setup
from .reading import MeasuredTests, static_tests

Array = np.ndarray
FILE = "load_tests.csv"
WITHIN = 0.1  # of synthetic tests: largest relative error of a compliance
# published claims (Cvitanic 2021, section 3.2) that the model does not confirm
PRINTED = (
    "without model error both methods give the same stiffness: the softer decoupled values in Cvitanic 2021 (Tables 1 "
    "and 2) do not follow from the model",
    "weighting rotations by 10 does not help: it widens the intervals, and in Cvitanic 2021 it even stiffens joint 4",
)
LACKS = (
    "the residuals are larger than the stated noise: links or bearings are compliant too, and the joint stiffness then "
    "absorbs part of their deflection"
)
MOMENT = "the arm's torque includes the moment of the load about the wrist centre, which Cvitanic 2021 leaves out"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StiffnessStudy(Study):
    """Joint stiffness with 95 % intervals, the other method for comparison, and doubts about the tests.

    notes: doubts about the tests, then published claims that the model does not confirm, then limits of each joint's
    determination. `interval("stiffness[0]")` [N.m/rad] and `interval("compliance[0]")` [rad/(N.m)] use the method
    reported first; joints are counted from 0.
    """

    fit: StiffnessFit | None = None
    method: Annotated[str | None, "method reported first"] = None
    stiffness: Annotated[Array | None, Quantity("N.m/rad", "by joint", written="MN.m/rad")] = None
    stiffness_interval: Annotated[
        Array | None,
        Quantity(
            "N.m/rad",
            "95 % interval of each; null: no upper end, or a negative compliance",
            key="interval_MNm_rad",
            written="MN.m/rad",
        ),
    ] = None
    compliance: Annotated[Array | None, Quantity("", "by joint, rad/(N.m)", key="compliance_rad_Nm")] = None
    other_method: Annotated[Array | None, Quantity("N.m/rad", "stiffness by the other method", written="MN.m/rad")] = (
        None
    )
    agree: Annotated[Sequence[bool] | None, "whether the intervals of both methods overlap"] = None
    compensator_rate: Annotated[
        Sequence[float] | None, Quantity("N/m", "estimated spring rate and its standard deviation")
    ] = None
    chi_squared_p: Annotated[float | None, "p-value of the residuals for the stated noise"] = None
    adequacy: Annotated[str | None, "result of that test in words"] = None
    adequate: Annotated[bool | None, "whether the residuals are noise of the stated size"] = None
    observability: Annotated[float | None, Quantity("", "O1 of the tests", key="observability_O1")] = None
    best_tests: Annotated[Sequence[int], "lines of the most informative tests"] = ()
    softest: Annotated[
        Array | None, Quantity("N/m", "stiffness of the tool by test, softest direction; null for negative compliances")
    ] = None
    stiffest: Annotated[Array | None, Quantity("N/m", "stiffness of the tool by test, stiffest direction")] = None
    synthetic: Annotated[str | None, "seed and noise of synthetic tests; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
        return [] if self.method is None else _rows(self.values, self.adequacy or "", self.synthetic)

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of "stiffness[0]", "compliance[0]" or another name of `estimate`.

        Raises ArgumentError if nothing was estimated, or not this name."""
        return super().interval(name, level) if self.fit is None else self.fit.interval(name, level)


@study_function
def stiffness_study(
    robot: Model,
    tests: MeasuredTests,
    setup: Setup | None = None,
    **work_options: Unpack[WorkOptions],
) -> StiffnessStudy:
    """Fit joint stiffness of an arm to static load tests: dX = J diag(J'F) c, c = 1/K (Cvitanic 2021, eqs. (2)-(6)).

    Args:
        robot: a serial arm with a spherical wrist.
        tests: measured tests in SI units, or from `read_load_tests` or `made_load_tests`.
        setup: tool, method, noise, and the gravity compensator of joint 2.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Raises ArgumentError.

    >>> import gtmodel as gt
    >>> from gtmodel.compliance import Load, Setup, SyntheticTests, made_load_tests, stiffness_study
    >>> poses = [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1], [1.0, -0.2, 1.8, 0.7, -2.0, 0.0], [0.4, -1.0, 2.3, 3.0, 1.2, -3.1]]
    >>> loads, truth = [Load([2e3, 0, 0]), Load([0, 0, -4e3])], SyntheticTests(stiffness=[2e6] * 6, seed=1)
    >>> setup = Setup(tool=[0.1, 0.05, 0.4])
    >>> tests = made_load_tests(gt.robots.kr500(), truth, poses, loads, setup)
    >>> stiffness_study(gt.robots.kr500(), tests, setup).status
    <SolveStatus.SOLVED: 'solved'>
    """
    work = Work(**work_options)
    setup = setup or Setup()
    work.progress("kinematics", 0.1)
    poses, static, spring = static_tests(robot, tests, setup)
    title = work.title or f"joint stiffness of {type(robot).__name__}"
    if tests.synthetic and "synthetic" not in title.lower():
        title += " (synthetic)"
    if work.interrupted():
        return StiffnessStudy(status=SolveStatus.INTERRUPTED, message="stopped before the fit", title=title)
    try:
        fits = _fits(setup, static, spring, poses.q)
        fit = fits[setup.method]
        best = select(static, min(setup.best, len(static.J)), fit.compliance).chosen
    except ValueError as error:
        if isinstance(error, ArgumentError) and error.argument:
            raise
        raise ArgumentError(str(error), "tests" if tests.truth is None else "load") from error
    files = {"parameters.toml": _parameters(fit, tests.synthetic)}
    if tests.truth is not None:
        files[FILE] = tests.text
    return StiffnessStudy(
        status=SolveStatus.SOLVED,
        message=f"{len(static.J)} tests, {fit.method}",
        title=title,
        objective=float(0.5 * fit.estimate.residuals @ fit.estimate.residuals),
        checks=_checks(tests, static, fit),
        figures={"stiffness": partial(_figure, tests, fits, title)},
        files=files,
        machine_files=("parameters.toml",),
        **_values(setup, tests, static, fits, best),
    )


def fitted_rows(tests: MeasuredTests) -> list[str]:
    """Lines of text: what is fitted to how many rows."""
    n = len(tests.q)
    return [
        f"{n} static load tests",
        "dX = J diag(J'F) c with c = 1/K, linear in the compliances (Cvitanic 2021, eqs. (2), (3), (6))",
        f"complete pose: {6 * n} rows; decoupled: {3 * n} rows of the wrist centre, then {3 * n} of the tool",
        *PRINTED,
    ]


def _fits(setup: Setup, tests: StaticTests, spring: Any, q: Array) -> dict[str, StiffnessFit]:
    if setup.compensator is None or not setup.compensator.estimate_rate:
        return {"complete_pose": complete_pose(tests), "decoupled": decoupled(tests)}
    if setup.method == "decoupled":
        raise ArgumentError("cannot estimate the compensator; use complete_pose", "setup.method")
    K_c = tests.K_c
    assert spring is not None and K_c is not None
    loads = K_c - spring.added(np.zeros_like(K_c), q)
    return {"complete_pose": with_compensator(tests.with_(K_c=loads), spring, q)}


def _checks(tests: MeasuredTests, static: StaticTests, fit: StiffnessFit) -> dict[str, Check]:
    # noise stated too large makes intervals wide, but not wrong
    small = fit.adequacy.statistic <= fit.estimate.degrees_of_freedom
    least = min(FALSE_ALARM, fit.adequacy.p) if small else FALSE_ALARM
    checks = {"chi_squared_p": at_least(fit.adequacy.p, least, "see the notes on the residuals")}
    checks |= _suspicions(tests, static, fit)[0]
    below = int(np.sum(fit.compliance <= 0))
    if below:
        checks["negative_compliances"] = at_most(float(below), 0.0, "see the notes for the joints")
    if tests.truth is not None:
        true = 1e-6 / (np.array(tests.truth) / 1e6)
        errors = np.abs(fit.compliance / true - 1)
        # the spring rate may follow the joints
        std = np.sqrt(np.diag(fit.estimate.covariance))[: len(true)]
        chance = half_width(1 - FALSE_ALARM / len(true)) * std / true
        bounds = np.maximum(WITHIN, chance)
        worst = int(np.argmax(errors / bounds))
        checks["compliance_error"] = at_most(float(errors[worst]), float(bounds[worst]))
    return checks


def _negative(fit: StiffnessFit) -> list[str]:
    """Sentences on joints with a negative compliance: beyond noise, or within it."""
    below = {
        "beyond noise, which is impossible: check for a wrong sign, swapped columns or a wrong unit in "
        "displacements, forces or angles": lambda c, high: high <= 0,
        "within its noise: the tests cannot tell the joint from a rigid one, so use the lower end of its interval":
        lambda c, high: c <= 0 < high,
    }  # fmt: skip
    highest = [fit.estimate.interval(f"compliance[{j}]")[1] for j in range(len(fit.compliance))]
    notes = []
    for how, test in below.items():
        joints = [str(j) for j, pair in enumerate(zip(fit.compliance, highest, strict=True), 1) if test(*pair)]
        if joints:
            which = f"joint{'s' if len(joints) > 1 else ''} {', '.join(joints)}"
            notes.append(f"with {fit.method} the compliance of {which} is negative {how}")
    return notes


def _suspicions(tests: MeasuredTests, static: StaticTests, fit: StiffnessFit) -> tuple[dict[str, Check], list[str]]:
    columns = {"q": tests.q, "wrench": static.wrench, "displacement": static.displacement}
    residuals = np.reshape(fit.estimate.residuals, (-1, 1))
    return suspicion_checks(tested(Data(columns, list(columns), "test", "line", tests.numbered, residuals=residuals)))


def _values(
    setup: Setup, tests: MeasuredTests, static: StaticTests, fits: dict[str, StiffnessFit], best: tuple[int, ...]
) -> dict[str, Any]:
    fit = fits[setup.method]
    other = next((f for name, f in fits.items() if name != setup.method), None)
    names = stiffness_names(range(len(fit.compliance)))
    # with a negative compliance no direction has a stiffness: null, not infinite
    sound = bool(np.all(fit.compliance > 0))
    stiffness, _ = softest_and_stiffest(translational_compliance(static.J, fit.compliance))
    doubts = [s for f in (fit, other) if f is not None for s in _negative(f)]
    doubts += _suspicions(tests, static, fit)[1]
    rate = None
    if RATE in fit.estimate.names:
        index = fit.estimate.names.index(RATE)
        rate = [float(fit.estimate.values[index]), float(fit.estimate.std[index])]
    return {
        "method": fit.method,
        "stiffness": fit.stiffness,
        "stiffness_interval": np.array([fit.interval(name) for name in names]),
        "compliance": fit.compliance,
        "other_method": None if other is None else other.stiffness,
        "agree": None if other is None else [_overlap(fit.interval(n), other.interval(n)) for n in names],
        "compensator_rate": rate,
        "chi_squared_p": fit.adequacy.p,
        "adequacy": fit.adequacy.message,
        "adequate": bool(fit.adequacy.passed),
        "observability": fit.identifiability.indices.o1,
        "best_tests": [int(tests.numbered[i]) for i in best],
        "softest": stiffness[:, 0] if sound else None,
        "stiffest": stiffness[:, -1] if sound else None,
        "notes": [*doubts, *([] if fit.adequacy.passed else [LACKS]), *PRINTED, MOMENT, *fit.identifiability.notes],
        "estimate": fit.estimate,
        "fit": fit,
        "synthetic": tests.synthetic,
    }


def _rows(v: Mapping[str, Any], adequacy: str, note: str | None) -> list[Row]:
    rows = [
        Row(f"stiffness of joint {j + 1}", f"{K:.4g} {_range(i)}", "MN.m/rad")
        for j, (K, i) in enumerate(zip(v["stiffness_MNm_rad"], v["interval_MNm_rad"], strict=True))
    ]
    if v["other_method_MNm_rad"] is not None:
        rows.append(Row("with the other method", listed(v["other_method_MNm_rad"]), "MN.m/rad"))
        rows.append(Row("intervals of both methods overlap", ", ".join("yes" if a else "no" for a in v["agree"])))
    if v["compensator_rate_N_m"] is not None:
        rate, std = v["compensator_rate_N_m"]
        rows.append(Row("rate of the gravity compensator", f"{rate:.4g} (std {std:.2g})", "N/m"))
    rows += [
        Row("residuals", adequacy),
        *([] if v["softest_N_m"] is None else [
            Row("softest direction of the tool, over the tests", f"{min(v['softest_N_m']) / 1e6:.4g} to "
                f"{max(v['softest_N_m']) / 1e6:.4g}", "N/um")]),
        Row("most informative tests, lines of the file", ", ".join(map(str, v["best_tests"]))),
    ]  # fmt: skip
    return [*rows, Row("SYNTHETIC", note)] if note else rows


def _range(ends: Sequence[float]) -> str:
    low, high = ends
    if np.isnan(low):
        return "(negative, no interval)"
    return f"(95 %: {low:.4g} to {f'{high:.4g}' if np.isfinite(high) else 'no upper end'})"


def _parameters(fit: StiffnessFit, note: str | None) -> str:
    import tomli_w

    comment = f"# synthetic: {note}\n" if note else ""
    return comment + tomli_w.dumps({"stiffness_MNm_rad": (fit.stiffness / 1e6).tolist()})


def _figure(tests: MeasuredTests, fits: dict[str, StiffnessFit], title: str) -> Any:
    from ...plot.compliance import stiffness_figure

    names = stiffness_names(range(len(tests.q[0])))
    rows = [(f.method, f.stiffness, np.array([f.interval(name) for name in names])) for f in fits.values()]
    true = None if tests.truth is None else np.array(tests.truth)
    note = tests.synthetic
    return stiffness_figure(rows, true, title=f"{title}\n(synthetic: {note})" if note else title)


def _overlap(a: tuple[float, float], b: tuple[float, float]) -> bool:
    return max(a[0], b[0]) <= min(a[1], b[1])
