"""The result of the calibration study, and its printed table."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from ..._lazy import hint
from ...results import ArgumentError, Quantity, Row, Study

if TYPE_CHECKING:
    from ...results.page.page import Sections
else:
    Sections = hint("gtmodel.results.page.page", "Sections")

WORST_ROWS = 5
SHOWN_WEAK = 3
SHOWN_DEPENDENT = 12
PARTS = {"fitted": "fitted poses", "held out": "held-out poses"}
WEAK = "determined no better than"  # of a combination, in words
NO_LENGTH = re.compile(r"( [xyz\d]+|^\w+\[\d+\])$")  # names of coordinates and numbered equations


def rows_of(values: Mapping[str, Any], degrees: bool = False) -> list[Row]:
    """The printed table: the verdict first. `degrees`: of angles, which are in rad otherwise."""
    noted = values.get("notes", ())  # notes have their own rows
    rows = [Row("verdict", s) for s in values["verdict"] if s not in noted]
    rows += [Row("outlier", _of_outlier(o)) for o in values["outliers"][:WORST_ROWS]]
    rows += _of_errors(values)
    for u in values["unknowns"]:
        rows += _of_unknown(u, degrees)
    if values["identifiability_after"]:
        sentences = values["identifiability_after"]["notes"]
        dependent = [s for s in sentences[1:] if WEAK not in s]
        shown = [*sentences[:1], *(dependent if len(dependent) <= SHOWN_DEPENDENT else ())]
        rows += [Row("identifiability", s) for s in shown]
        if len(dependent) > SHOWN_DEPENDENT:
            rows.append(Row("identifiability", f"{len(dependent)} parameters move with others; see result.json"))
        weak = sum(WEAK in s for s in sentences)
        if values["recordings"] is not None and weak <= SHOWN_WEAK:
            rows += [Row("identifiability", s) for s in sentences if WEAK in s]
        elif weak:
            rows.append(Row("identifiability", f"{weak} combinations are {WEAK} they were known; see result.json"))
    if values["synthetic"]:
        rows.append(Row("synthetic", values["synthetic"].partition(";")[0]))
    return rows


def _of_unknown(u: Mapping[str, Any], degrees: bool) -> list[Row]:
    """Value before and after, and the interval."""
    factor, unit = (180 / math.pi, "deg") if degrees and u["unit"] == "rad" else (1.0, u["unit"])
    rows = [Row(u["name"], f"{factor * u['start']:.6g} -> {factor * u['value']:.6g}", unit)]
    if u["interval_95"] is not None:
        low, high = u["interval_95"]
        rows.append(Row("  95 % interval", f"{factor * low:.7g} to {factor * high:.7g}", unit))
    elif u["std"] is None:
        rows.append(Row("  95 % interval", "not determined by these poses"))
    else:
        rows.append(Row("  std if residuals were white noise", factor * u["std"], unit))
    return rows


def _of_outlier(o: Mapping[str, Any]) -> str:
    if "column" not in o:
        return f"line {o['line']}, {o['link']}: {o['residual_mm']:.3g} mm, {o['times']:.1f} std"
    return f"{o['pose']}: {o['column']} off by {o['off_mm']:.3g} mm, other poses by {o['others_mm']:.2g} mm"


def _of_errors(values: Mapping[str, Any]) -> list[Row]:
    """Rows on the errors of the poses."""
    rows = []
    if values["recordings"] is None:
        for n, v in values["link_errors_mm"].items():
            rows.append(Row(f"mean {'' if NO_LENGTH.search(n) else 'length '}error of {n}", v, "mm"))
    for recording in values["recordings"] or ():
        rows += _of_recording(recording)
    headline = (("a_priori_mm", "before calibration"), ("fitted_mm", "fitted poses"), ("held_out_mm", "held-out poses"))
    for key, label in headline if values["recordings"] is None else ():
        if values[key]:
            rows.append(Row(f"positioning error, {label}: mean", values[key]["mean"], "mm"))
            rows.append(Row("  largest", values[key]["max"], "mm"))
    for w in values["largest"] or ():
        place = ", ".join(f"{x:.3f}" for x in w["position_m"])
        text = f"line {w['line']}: {w['error_mm']:.3g} mm, most in {w['column']} ({w['off_mm']:.3g} mm), at ({place}) m"
        rows.append(Row(f"largest error, {PARTS[w['part']]}", text))
    if values["principal"]:
        for size, d in zip(values["principal"]["rms_mm"], values["principal"]["directions"], strict=True):
            rows.append(Row(f"rms error along ({', '.join(f'{x:.2f}' for x in d)})", size, "mm"))
    if values["repeatability_mm"] is not None:
        rows.append(Row("repeatability, rms", values["repeatability_mm"], "mm"))
    return rows


def _of_recording(recording: Mapping[str, Any]) -> list[Row]:
    """Rows on the errors of one of the measurements."""
    rows = []
    for name, e in recording["errors"].items():
        for key, label in (("a_priori", "before calibration"), ("fitted", "fitted"), ("held_out", "held out")):
            if e[key] is not None:
                rows.append(Row(f"{recording['name']}, {name}, {label}: rms", e[key]["rms"], e["unit"]))
                rows.append(Row("  largest", e[key]["max"], e["unit"]))
    return rows


STIFFNESS = (
    "with [joint_stiffness]: method, stiffness_MNm_rad with interval_MNm_rad (95 %; null: no upper end) and "
    "compliance_rad_Nm by joint, other_method_MNm_rad and agree (whether intervals overlap), compensator_rate_N_m and "
    "its std, chi_squared_p, adequacy and adequate, observability_O1, best_tests (lines of the file), "
    "softest_N_m and stiffest_N_m by test (null for a negative compliance); all other values are then null except "
    "synthetic and notes (doubts about the tests and the published values)"
)
ABOVE = ("synthetic", "notes")  # values of joint stiffness that the calibration has itself


Numbers = Mapping[str, float] | None
Table = Mapping[str, Any] | None
Tables = Sequence[Mapping[str, Any]] | None
Lines = Sequence[str] | None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CalibrationStudy(Study):
    """Calibrated parameters with their intervals, errors on fitted and held-out poses, and the verdict in words.

    withheld: why `interval` refuses, in a sentence, empty if intervals are valid; otherwise `estimate` is None.
    degrees: whether the printed table has angles in degrees, as the file does.
    """

    draws_residuals: ClassVar[bool] = True
    captions: ClassVar[Mapping[str, str]] = {
        "pose_errors": "Positioning error per pose (compare Dressler 2012, Fig. 5.1); dashed: mean; ring: the largest.",
        "workspace_errors": "Positioning error over the workspace; squares: held-out poses; ring: largest error.",
        "residuals": "Errors of each link, or coordinate of the tool, in the fitted poses; bars within the dotted band "
        "are what white noise would show.",
        "deviations": "Standard deviation of each unknown.",
        "correlation": "Correlation of the unknowns.",
        "stiffness": "Stiffness of each joint with 95 % confidence intervals, for both methods.",
    }

    withheld: str = ""
    degrees: bool = False

    parameters: Annotated[Numbers, Quantity("",
        "all geometric parameters in the closure equations by name, calibrated and fixed, in SI units",
    )] = None  # fmt: skip
    unknowns: Annotated[Tables, Quantity("",
        "for each unknown: name, unit, start, value, std and interval_95, null if the poses do not "
        "determine it; if the residuals are not white noise (intervals_hold false), interval_95 is null and std is "
        "only what white noise would give",
    )] = None  # fmt: skip
    intervals_hold: Annotated[bool | None, Quantity("",
        "whether 95 % intervals are valid; the notes say why not, or what they assume",
    )] = None  # fmt: skip
    colour_tested: Annotated[bool | None, Quantity("",
        "whether there are enough poses to test for coloured residuals (guideway errors, drift)",
    )] = None  # fmt: skip
    measurement: Annotated[Numbers, Quantity("",
        "estimated frames, scales, offsets and delays of the measurement by name, in SI units",
    )] = None  # fmt: skip
    poses: Annotated[Mapping[str, int] | None, Quantity("",
        "number of poses fitted and held out, of places measured more than once, and left_out if `leave_out` names any",
    )] = None  # fmt: skip
    link_errors: Annotated[Numbers, Quantity("m",
        "mean length error of each link over the fitted poses (Dressler 2012, eq. (5.13)); for arms, mean error of "
        "each tool coordinate", written="mm",
    )] = None  # fmt: skip
    held_out_link_rms: Annotated[Numbers, Quantity("m",
        "root mean square of these errors on the held-out poses; null without any", written="mm",
    )] = None  # fmt: skip
    held_out: Annotated[Numbers, Quantity("m",
        "positioning error (5.5) of the held-out poses: mean, max, rms; null without any", written="mm",
    )] = None  # fmt: skip
    fitted: Annotated[Numbers, Quantity("m", "positioning error of the fitted poses", written="mm")] = None
    a_priori: Annotated[Numbers, Quantity("m",
        "positioning error before calibration, on the held-out poses or else the fitted ones", written="mm",
    )] = None  # fmt: skip
    orientation: Annotated[Numbers, Quantity("rad",
        "angle between predicted and measured orientation of held-out poses; null if not measured", written="deg",
    )] = None  # fmt: skip
    worst: Annotated[Table, Quantity("",
        "the held-out pose with the largest error, without any the fitted one: line, measured position_m, error_mm and "
        "whether it was held_out",
    )] = None  # fmt: skip
    largest: Annotated[Tables, Quantity("",
        "the largest error of each part (fitted, held out): line, measured position_m, error_mm, and the column with "
        "the largest error off_mm, predicted less measured",
    )] = None  # fmt: skip
    principal: Annotated[Table, Quantity("",
        "rms error rms_mm along each principal direction, the smallest first, and the directions",
    )] = None  # fmt: skip
    identifiability_before: Annotated[Table, Quantity("",
        "rank, redundant, condition, observability indices and notes, before measuring",
    )] = None  # fmt: skip
    identifiability_after: Annotated[Table, Quantity("",
        "as identifiability_before, at the solution, with the noise of the residuals",
    )] = None  # fmt: skip
    correlated: Annotated[Sequence[Sequence[Any]] | None, Quantity("",
        "pairs of unknowns that correlate by more than 0.95",
    )] = None  # fmt: skip
    outliers: Annotated[Tables, Quantity("",
        "poses far beyond the others: line, whether held_out, the column with the largest error off_mm (predicted "
        "less measured), error_mm, the median error others_mm of the other poses, the link with its largest "
        "residual_mm, and times (in standard deviations)",
    )] = None  # fmt: skip
    repeatability: Annotated[float | None, Quantity("m",
        "rms distance of poses at the same actuators from their mean; null without any", written="mm",
    )] = None  # fmt: skip
    recordings: Annotated[Tables, Quantity("",
        "for several or partial measurements: name, numbers of poses fitted and held_out, "
        "link_errors_mm, and errors by signal: unit, and mean, max, rms and lost poses a_priori, fitted and held_out",
    )] = None  # fmt: skip
    sensitivity: Annotated[Mapping[str, Numbers] | None, Quantity("",
        "sums (5.8) of changes for a small step of each unknown: position_mm, orientation_deg, cost_m4; null "
        "if the pose is not determined",
    )] = None  # fmt: skip
    numerics_sound: Annotated[bool | None, Quantity("", "whether the iteration converged")] = None
    prediction_proven: Annotated[bool | None, Quantity("",
        "whether held-out poses are predicted as well as fitted ones; null without any",
    )] = None  # fmt: skip
    verdict: Annotated[Lines, Quantity("", "verdict in sentences, with its scope")] = None
    truth: Annotated[Numbers, Quantity("", "true parameters of a synthetic robot; null for measured poses")] = None
    synthetic: Annotated[str | None, Quantity("", "seed and noise of synthetic poses; null for measured ones")] = None
    joint_stiffness: Annotated[Study | None, Quantity("", STIFFNESS)] = None

    @property
    def values(self) -> Mapping[str, Any]:
        """Return the fields of result.json; those of joint stiffness have the names of the joint stiffness study."""
        values = dict(super().values)
        if self.joint_stiffness is not None:
            values["joint_stiffness"] = {n: v for n, v in self.joint_stiffness.values.items() if n not in ABOVE}
        return values

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of an unknown [SI], infinite if the poses do not determine it.

        For joint stiffness it is the interval of the joint stiffness study. Raises ArgumentError if intervals are not
        valid, with the reason, and for an unknown name."""
        if self.withheld:
            raise ArgumentError(self.withheld, "name")
        return (self.joint_stiffness or super()).interval(name, level)

    @property
    def rows(self) -> list[Row]:
        """The printed table."""
        if self.joint_stiffness is not None:
            return self.joint_stiffness.rows
        return [] if self.parameters is None else rows_of(self.values, self.degrees)

    @property
    def sections(self) -> Sections:
        """Accuracy, parameters and identifiability, or the stiffness of the joints; none before the fit."""
        from .sections import sections_of, stiffness_sections  # here: a fit needs no page

        if self.joint_stiffness is not None:
            return stiffness_sections(self.values["joint_stiffness"])
        return {} if self.parameters is None else sections_of(self.values)
