"""What `values` of kind "vibration" hold, and how numbers of it are written."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from gtmodel.inference import FALSE_ALARM
from gtmodel.results.estimate import Estimate

VALUES = {
    "words": "what limits the result: identifiability, residuals, signs, in sentences",
    "frequency_Hz": "undamped, by mode",
    "frequency_interval_Hz": "95 % intervals by mode, where they are fitted",
    "damping": "ratio by mode",
    "damping_interval": "95 % intervals by mode, where they are fitted",
    "distance": "of neighbouring resonances in half-power widths; below 1 they overlap",
    "order": "number of states",
    "order_by_gap": "where the singular values fall most",
    "singular_values": "of the weighted projection",
    "held_out_fit_percent": "by output, of samples that were not fitted; 100 is exact",
    "held_out_rms_m": "by order tried; null where it is unstable",
    "residual_m": "rms by output",
    "poles_1_s": "of the model in continuous time, real and imaginary part",
    "M_inv_K_1_s2": "of the physical form, row by row",
    "M_inv_D_1_s": "of the physical form, row by row",
    "M_kg": "masses; null where neither a force nor a mass is known",
    "D_kg_s": "damping, likewise",
    "K_N_m": "stiffness, likewise",
    "intervals": "95 % intervals by name: M[0,0] and so on, or a and b",
    "stable": "whether all poles decay",
    "signs": "which change of signs makes printed matrices stable",
    "definite": "M_kg, D_kg_s, K_N_m of the nearest passive structure",
    "a": "pole of the step response",
    "b": "numerator of the step response",
    "delay_samples": "delay of the step response",
    "delay_sure": "whether its neighbours are rejected at 1 %",
    "gain": "b / (1 - a), with its interval",
    "bandwidth_Hz": "-3 dB of the step response, with its interval",
    "synthetic": "seed and noise of made-up recordings; null for measured ones",
}


def values(**found: Any) -> dict[str, Any]:
    """All of VALUES in their order; null where this model has none."""
    return {name: found.get(name) for name in VALUES}


def listed(numbers: Iterable[float], form: str = ".5g") -> str:
    """Numbers with commas between."""
    return ", ".join(f"{x:{form}}" for x in numbers)


def rows_of(X: np.ndarray) -> str:
    """A matrix in one line, rows divided by semicolons."""
    return "; ".join(listed(row) for row in np.asarray(X))


def pairs_of(numbers: np.ndarray) -> list[list[float]]:
    """Complex numbers as real and imaginary part."""
    return [[float(z.real), float(z.imag)] for z in numbers]


def interval(ends: tuple[float, float] | None, form: str = ".5g") -> str:
    """An interval in brackets, nothing where there is none."""
    return "" if ends is None else f" ({ends[0]:{form}} .. {ends[1]:{form}})"


def said(title: str, synthetic: str | None) -> str:
    """A picture's title, with the word where the data are made up."""
    return f"{title}\n(synthetic: {synthetic})" if synthetic else title


def by_chance(estimate: Estimate, names: Sequence[str]) -> np.ndarray:
    """By how much noise may move each of these estimates (n,), all of them together but for false alarms."""
    ends = [estimate.interval(name, 1 - FALSE_ALARM / len(names)) for name in names]
    return np.array([(high - low) / 2 for low, high in ends])
