"""What an identification must pass, and what looks wrong with its log, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..inference import FALSE_ALARM, binomial_band, negligible
from ..measurements.inspection.data_tests import Data, tested
from ..results import Check, at_least, at_most
from ..results.estimate import half_width
from ..results.suspicion import accepted_checks, suspicion_checks
from .asked import Asked
from .exchanged import exchanged_efforts, leaves
from .inertia import Identification, Validation
from .recordings import Recordings
from .repeated import Repeated
from .rows import recorded
from .work import DEVIATIONS, work_of

LOOK = "the notes say what to look at"
READ = f"{LOOK}; what is right all the same is named in accept"
UNEXPLAINED = 0.5  # rms of what is left over rms of the effort: beyond, the model is not that of the log
FAR = 300.0  # times the nominal value: a factor 1000 of a unit, not a payload
SATURATED = 0.02  # of the samples at the largest or smallest reading: noise alone does not stay there
TINY = np.finfo(float).tiny
PILED = 5.0  # times as many samples as at the reading next to it: a coarse reading of a smooth peak has up to 2.5


def judged(
    asked: Asked,
    data: Recordings,
    identification: Identification,
    validation: Validation | None,
    repeated: Repeated | None,
) -> tuple[dict[str, Check], list[str]]:
    """Checks by name, as they stand in the result; and sentences on signs, units, order of columns and saturation that
    the log is suspected of."""
    rows, said = identification.rows, list[str]()
    checks = {"undetermined": at_most(float(identification.identifiability.redundant), 0.0, LOOK)}
    # what was left out shifts the others: then the truth is not what the fit is after
    whole = all(t.passed for t in identification.left_out)
    if data.truth and whole:
        e = identification.estimate
        off = [abs(e.value(n) - data.truth[n]) / s for n, s in zip(e.names, e.std, strict=True) if n in data.truth]
        checks["error_in_standard_deviations"] = at_most(
            float(max(off, default=0.0)), half_width(1 - FALSE_ALARM / max(len(off), 1), e.degrees_of_freedom)
        )
    if validation is not None:
        held_out = max(validation.judged, key=lambda h: h.ratio / h.bound)
        checks["held_out_over_fitted_noise"] = held_out.check(LOOK)
    shares = np.sqrt(np.mean(identification.residuals**2, axis=0) / np.mean(rows.effort**2, axis=0))
    checks["unexplained_share"] = at_most(float(np.max(shares)), UNEXPLAINED, READ)
    said += [
        f"{t}: {100 * share:.3g} % of its rms are left unexplained; check sign, order and units of the columns"
        for t, share in zip(rows.targets, shares, strict=True)
        if share > UNEXPLAINED
    ]
    order = exchanged_efforts(identification)
    if order is not None and not order.passed:
        said.append(leaves(order).sentence)
    work = work_of(identification)
    if work is not None:
        if np.any(work.friction):  # some friction is free
            # of what the noise leaves: a drive without friction takes and gives nothing on average
            worst = int(np.argmin(work.friction / np.maximum(work.friction_noise, TINY)))
            least = -DEVIATIONS * float(work.friction_noise[worst])
            checks["work_of_friction_J"] = at_least(float(work.friction[worst]), min(least, 0.0), READ)
        other = work if validation is None else work_of(identification, validation.rows) or work
        checks["energy_balance"] = Check(other.balance, other.bound, LOOK, judged=other.balanced)
        said += work.driving(rows.targets) + other.unbalanced()
    delay = identification.delay
    if delay is not None:
        checks["delay_moves_a_parameter"] = Check(delay.moves, delay.bound, READ, judged=delay.passed)
    if order is not None:
        checks["exchanged_columns"] = Check(order.ratio, order.bound, READ, judged=order.passed)
    far = _far_off(identification, asked.regressor.base)
    checks["parameters_far_off"] = at_most(float(len(far)), 0.0, READ)
    piled = _piled(data, asked.how.targets)
    checks["saturated_share"] = at_most(max((share for share, _ in piled), default=0.0), SATURATED, READ)
    said += [*far, *(sentence for share, sentence in piled if share > SATURATED)]
    if identification.left_out:
        group = min(identification.left_out, key=lambda t: t.p * t.tests)
        least = FALSE_ALARM / group.tests
        checks["nothing_left_out"] = at_least(group.p, least, "free the parameters that the residual test names")
    if repeated is not None and not repeated.runs.interrupted:
        seen = repeated.coverage
        low, high = binomial_band(seen.runs, seen.level, 1 - FALSE_ALARM / len(seen.names))
        outside = int(np.count_nonzero((seen.hits < low) | (seen.hits > high))) + len(seen.biased)
        checks["parameters_outside_the_binomial_band"] = at_most(float(outside), 0.0)
    left = Data(residuals=identification.residuals / identification.noise)
    more, sentences = suspicion_checks(tested(recorded(data.fitted, asked.names), left), asked.how.accept)
    checks, said = checks | more, [*said, *sentences]
    checks, accepted = accepted_checks(checks, asked.how.accept)
    return checks, [*said, *accepted]


def _far_off(identification: Identification, base: Sequence[str]) -> list[str]:
    """Where a unit of position, time or effort is off by its thousand, a parameter is, or all are; those of `base` are
    sums and differences, which may be small."""
    rows, e = identification.rows, identification.estimate
    sized = np.where(negligible(rows.nominal, rows.units), 0.0, rows.nominal)
    nominal = dict(zip(rows.names, sized, strict=True))
    nonzero = [n for n in e.names if nominal[n] and n not in base and e.interval(n)[0] * e.interval(n)[1] > 0]
    ratios = {n: abs(e.value(n) / nominal[n]) for n in nonzero}
    far = [n for n in nonzero if ratios[n] > FAR] or (nonzero if nonzero and max(ratios.values()) < 1 / FAR else [])
    if not far:
        return []
    return [f"{far[0]} is {ratios[far[0]]:.3g} times its nominal value; check the units of time, position and efforts"]


def _piled(data: Recordings, targets: str) -> list[tuple[float, str]]:
    """Share of the samples and a sentence, of readings that pile up at an end."""
    readings = []
    for session in data.fitted:
        unit = session.trajectory.unit(targets)
        effort = session.trajectory[targets].reshape(len(session.trajectory), -1)
        for k, column in enumerate(effort.T):
            name = targets if effort.shape[1] == 1 else f"{targets}[{k}]"
            levels, counts = np.unique(column, return_counts=True)
            if len(levels) < 2:
                continue
            for end, at, beside in (("largest", -1, -2), ("smallest", 0, 1)):
                if counts[at] > PILED * counts[beside]:
                    share = float(counts[at] / len(column))
                    sentence = (
                        f"{name} of {session.name} stands at its {end} value, {levels[at]:.5g} {unit}, in "
                        f"{100 * share:.2g} % of the samples; if the sensor saturates there, the numbers are off"
                    )
                    readings.append((share, sentence))
    return readings
