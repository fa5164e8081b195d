"""Options of an excitation: family of motions, experiment, search; and the result of its study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np

from ...results import Row, Study
from ...results.options import Long, Options, Unit, Within


@dataclass(frozen=True)
class Family(Options):
    """The family of motions of the tool centre point, each from rest to rest, ending where it begins.

    >>> gt.identify.Family(period=2.0, place_low=[0.9, -0.9], place_high=[1.1, -0.7, 0.6])
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: place_low: expected 3 numbers; found 2
    """

    family: Annotated[Literal["fourier", "spline"], "finite Fourier series or spline"] = "fourier"
    period: Annotated[float, Unit("s"), Within(above=0.0), "period of the motion, which can be repeated"] = field(
        kw_only=True
    )
    harmonics: Annotated[int, Within(least=2, most=30), "fourier: number of harmonics"] = 5
    intervals: Annotated[int, Within(least=2, most=60), "spline: number of polynomial pieces"] = 12
    place_low: Annotated[
        list[float], Unit("m"), Long(3), "lower corner of the box of the rest positions of random motions"
    ] = field(kw_only=True)  # fmt: skip
    place_high: Annotated[list[float], Unit("m"), Long(3), "upper corner of that box"] = field(kw_only=True)


@dataclass(frozen=True)
class IdentificationExperiment(Options):
    """Identified parameters, and how they will be measured.

    >>> gt.identify.IdentificationExperiment(noise=50.0, periods=4).identified
    ['m_p', 'm_c', 'coulomb', 'viscous']
    """

    identified: Annotated[list[str], "parameters to identify; arrays by name"] = field(
        default_factory=lambda: ["m_p", "m_c", "coulomb", "viscous"]
    )
    noise: Annotated[
        float, Unit("N"), Within(above=0.0), "white noise of the measured forces, standard deviation"
    ] = 30.0  # fmt: skip
    periods: Annotated[int, Within(least=1), "repetitions of the motion in an experiment"] = 1
    sample: Annotated[
        float, Unit("s"), Within(above=0.0), "sample time of the log and of trajectory.csv"
    ] = 0.004  # fmt: skip
    sign_smoothing: Annotated[
        float, Unit("m/s"), Within(above=0.0),
        "velocity over which the optimisation smooths the sign of Coulomb friction",
    ] = 0.02  # fmt: skip


@dataclass(frozen=True)
class ExcitationSearch(Options):
    """The optimisation: criterion, starts, iterations.

    >>> gt.identify.ExcitationSearch(criterion="best")
    Traceback (most recent call last):
    gtmodel.results.agreement.WrongKind: criterion: expected one of condition, determinant, variance; found 'best'
    """

    criterion: Annotated[
        Literal["condition", "determinant", "variance"],
        "least condition number (a smooth bound of it); largest determinant of the information; least sum "
        "of the relative variances",
    ] = "condition"
    starts: Annotated[int, Within(least=1), "number of the best random motions to start from"] = 3
    max_iterations: Annotated[int, Within(least=1), "limit of iterations for each start"] = 400


@dataclass(frozen=True)
class RandomMotions(Options):
    """Random feasible motions, a baseline and start points.

    >>> gt.identify.RandomMotions(draws=0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: draws: must be at least 1; found 0
    """

    draws: Annotated[int, Within(least=1), "number of motions"] = 100
    seed: Annotated[int, Within(least=0), "of the random motions"] = 1


@dataclass(frozen=True)
class MonteCarloFits(Options):
    """Synthetic identifications along the optimised and the best random motion.

    >>> gt.identify.MonteCarloFits(runs=10_000)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: runs: must be at least 0 and at most 5000; found 10000
    """

    runs: Annotated[int, Within(least=0, most=5000), "number of runs; none if 0"] = 0
    seed: Annotated[int, Within(least=0), "of the noise"] = 0


Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ExcitationStudy(Study):
    """The optimised motion and random ones for comparison; all None if stopped before the first random motion."""

    condition: Annotated[
        float | None,
        "condition number of the regressor along the optimised motion, columns scaled by nominal values",
    ] = None
    random_condition: Annotated[Mapping[str, float] | None, "condition numbers of random motions: best, median"] = None
    improvement: Annotated[
        float | None, "best random condition number over the optimised one"
    ] = None  # fmt: skip
    criterion: Annotated[str | None, "the optimised criterion"] = None
    parameters: Annotated[
        Sequence[Mapping[str, Any]] | None,
        "for each: name, nominal, unit, deviation (predicted standard deviation in an experiment), "
        "random_deviation (along the best random motion), ratio of the two; and, with monte_carlo, seen_deviation, "
        "random_seen_deviation (observed scatter) and hits of its 95 % interval along the optimised motion",
    ] = None
    coverage: Annotated[
        Mapping[str, Any] | None,
        "with monte_carlo: runs, band of hits, pooled share of 95 % intervals that contain the truth; or null",
    ] = None
    singular_values: Annotated[
        Mapping[str, Array] | None,
        "singular values of the scaled regressor over the square root of samples, largest first: optimised and random",
    ] = None
    limits: Annotated[
        Mapping[str, float] | None,
        "by key: the least margin on the fine grid, relative to the bound, or in m for positions",
    ] = None
    coefficients: Annotated[
        Mapping[str, Array] | None,
        "coefficients of the optimised motion: place_m, cosine_m and sine_m (harmonics, 3); controls_m for a spline",
    ] = None
    unknowns: Annotated[Array | None, "unknowns of the motion, for --start"] = None
    draws: Annotated[int | None, "number of random motions"] = None

    @property
    def rows(self) -> list[Row]:
        """Rows of the table."""
        if self.random_condition is None or self.parameters is None:
            return []
        rows = [
            Row("condition number, optimised", self.condition),
            Row(f"best of {self.draws} random motions", self.random_condition["best"]),
            Row("median of the random motions", self.random_condition["median"]),
            Row("best random over optimised", self.improvement),
        ]
        for p in self.parameters:
            text = f"{p['deviation']:.3g}, random {p['random_deviation']:.3g}"
            rows.append(Row(f"{p['name']} = {p['nominal']:g}, deviation", text, p["unit"]))
        rows += [Row(f"least margin of {key}", margin) for key, margin in (self.limits or {}).items()]
        if self.coverage is not None:
            low, high = self.coverage["band"]
            hits = [p["hits"] for p in self.parameters]
            label = f"intervals with the truth in {self.coverage['runs']} synthetic fits, {low} to {high} expected"
            rows.append(Row(label, f"{min(hits)} to {max(hits)}"))
            rows.append(Row("pooled coverage of 95 % intervals", self.coverage["pooled"]))
        return rows
