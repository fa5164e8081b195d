"""Do recordings of one machine agree: what each of them gives for a parameter, and how far they are apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..results.estimate import Estimate, half_width
from ..results.refusal import ArgumentError
from .held_out import FALSE_ALARM


@dataclass(frozen=True, eq=False)
class BetweenRecordings:
    """Parameters of which recordings give disjoint intervals, `apart`, of all `names` that were compared.

    `spread`: by name, the standard deviation [unit of the parameter] between recordings beyond what their own noise
    explains. `worst`: the name that is farthest apart in standard deviations, `pair` the two recordings.
    """

    names: tuple[str, ...]
    apart: tuple[str, ...]
    spread: dict[str, float]
    worst: str
    pair: tuple[str, str]
    intervals: tuple[tuple[float, float], tuple[float, float]]
    unit: str

    @property
    def message(self) -> str:
        ends = " and ".join(
            f"{low:.6g} to {high:.6g} in {name}"
            for name, (low, high) in zip(self.pair, self.intervals, strict=True)
        )  # fmt: skip
        return (
            f"recordings have disjoint 95 % intervals of {len(self.apart)} of {len(self.names)} parameters, most of "
            f"all {self.worst}: {ends}; between recordings it varies by {self.spread[self.worst]:.2g} {self.unit} "
            "beyond their noise: an interval describes its recordings, not the machine"
        )


def between_recordings(
    estimates: Mapping[str, Estimate], names: Sequence[str], *, false_alarm: float = FALSE_ALARM
) -> BetweenRecordings | None:
    """Compare the estimates of recordings, by name, parameter by parameter; None where they agree within their noise.

    Disjoint are 95 % intervals that do not meet, of values that lie farther apart than chance puts any two of them with
    probability `false_alarm`. What a recording does not determine is not compared. Raises ArgumentError for fewer than
    two recordings.

    >>> def recorded(rng, k):  # the mean of fifty values, which another day shifts
    ...     return gt.inference.linear_fit(np.ones((50, 1)), 3 + 0.5 * k + 0.1 * rng.normal(size=50), ["m"])
    >>> first, second = gt.inference.monte_carlo(recorded, 2, seed=1, processes=0).results
    >>> seen = gt.inference.between_recordings({"monday": first, "friday": second}, ["m"])
    >>> seen.apart, round(seen.spread["m"], 1)
    (('m',), 0.4)
    >>> gt.inference.between_recordings({"monday": first, "again": first}, ["m"]) is None
    True
    """
    if len(estimates) < 2:
        raise ArgumentError(f"expected two recordings or more; found {len(estimates)}", "estimates")
    pairs = list(combinations(estimates, 2))
    bound = half_width(1 - false_alarm / max(len(pairs) * len(names), 1))
    apart, spread, best = [], {}, (0.0, "", pairs[0])
    for name in names:
        known = {s: (e.value(name), float(e.std[e.names.index(name)]), e.interval(name)) for s, e in estimates.items()
                 if name in e.names and np.isfinite(e.std[e.names.index(name)])}  # fmt: skip
        if len(known) < 2:
            continue
        values, std, _ = (np.array(x) for x in zip(*known.values(), strict=True))
        spread[name] = float(np.sqrt(max(np.var(values, ddof=1) - np.mean(std**2), 0.0)))
        farthest = 0.0
        for a, b in pairs:
            if a not in known or b not in known:
                continue
            (x, sx, (low, high)), (y, sy, (least, most)) = known[a], known[b]
            z = abs(x - y) / max(float(np.hypot(sx, sy)), np.finfo(float).tiny)
            if z > bound and (high < least or most < low):
                farthest = max(farthest, z)
                best = max(best, (z, name, (a, b)))
        if farthest:
            apart.append(name)
    if not apart:
        return None
    _, worst, pair = best
    first, second = estimates[pair[0]], estimates[pair[1]]
    unit = first.units[first.names.index(worst)] if first.units else ""
    return BetweenRecordings(
        tuple(spread), tuple(apart), spread, worst, pair, (first.interval(worst), second.interval(worst)), unit or "1"
    )
