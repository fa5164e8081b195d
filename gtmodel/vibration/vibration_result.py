"""Base class of all vibration results, and how their numbers are printed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ..inference import FALSE_ALARM
from ..results import Estimate, Quantity, Row, Study
from ..results.study import to_inherit

Array = np.ndarray


@to_inherit
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class VibrationStudy(Study):
    """The model of a vibrating structure. Fields that the model does not determine are None."""

    frequency: Annotated[Sequence[float] | Array | None, Quantity("Hz", "undamped, by mode")] = None
    frequency_interval: Annotated[
        Sequence[Sequence[float]] | None, Quantity("Hz", "95 % intervals by mode, if fitted")
    ] = None
    damping: Annotated[Sequence[float] | Array | None, "ratio by mode"] = None
    damping_interval: Annotated[Sequence[Sequence[float]] | None, "95 % intervals by mode, if fitted"] = None
    distance: Annotated[
        Array | None, "distance of neighbouring resonances in half-power widths; below 1 they overlap"
    ] = None
    order: Annotated[int | None, "number of states"] = None
    order_by_gap: Annotated[int | None, "order after which the singular values fall most"] = None
    singular_values: Annotated[Array | None, "of the weighted projection"] = None
    held_out_fit: Annotated[Array | None, Quantity("%", "by output, on held-out samples; 100 is exact")] = None
    held_out_rms: Annotated[
        Mapping[str, float | None] | None, Quantity("m", "by order; null if unstable")
    ] = None  # fmt: skip
    residual: Annotated[Sequence[float] | Array | None, Quantity("m", "rms by output")] = None
    poles: Annotated[
        Sequence[Sequence[float]] | None,
        Quantity("1/s", "poles of the model in continuous time, real and imaginary part"),
    ] = None
    M_inv_K: Annotated[
        Array | None, Quantity("1/s2", "of the physical form, row by row", key="M_inv_K_1_s2")  # K is no kelvin
    ] = None
    M_inv_D: Annotated[Array | None, Quantity("1/s", "of the physical form, row by row")] = None
    M: Annotated[Array | None, Quantity("kg", "masses; null without a known force or mass")] = None
    D: Annotated[Array | None, Quantity("kg/s", "damping; null without a known force or mass")] = None
    K: Annotated[Array | None, Quantity("N/m", "stiffness; null without a known force or mass")] = None
    intervals: Annotated[
        Mapping[str, Sequence[float]] | None,
        "95 % intervals by name: M[0,0] and so on, or a and b",
    ] = None
    stable: Annotated[bool | None, "whether all poles decay"] = None
    signs: Annotated[Sequence[str] | None, "stability of printed matrices by change of signs"] = None
    definite: Annotated[Mapping[str, Any] | None, "M_kg, D_kg_s, K_N_m of the nearest passive structure"] = None
    a: Annotated[float | None, "pole of the step response"] = None
    b: Annotated[float | None, "numerator of the step response"] = None
    delay_samples: Annotated[int | None, "delay of the step response"] = None
    delay_sure: Annotated[bool | None, "whether the neighbouring delays are rejected at 1 %"] = None
    gain: Annotated[Sequence[float] | None, "b / (1 - a), with its interval"] = None
    bandwidth: Annotated[
        Sequence[float | None] | None, Quantity("Hz", "-3 dB of the step response, with its interval")
    ] = None
    synthetic: Annotated[str | None, "seed and noise of synthetic recordings; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """Rows of the table."""
        synthetic = [Row("SYNTHETIC", self.synthetic)] if self.synthetic else []
        return [*self._model_rows(), *synthetic]

    def _model_rows(self) -> list[Row]:
        return []


def numbers(values: Iterable[float], form: str = ".5g") -> str:
    """Numbers separated by commas."""
    return ", ".join(f"{x:{form}}" for x in values)


def rows_of(X: Array) -> str:
    """A matrix in one line, rows separated by semicolons."""
    return "; ".join(numbers(row) for row in np.asarray(X))


def pairs_of(values: Array) -> list[list[float]]:
    """Complex numbers as pairs of real and imaginary part."""
    return [[float(z.real), float(z.imag)] for z in values]


def interval(ends: tuple[float, float] | None, form: str = ".5g") -> str:
    """An interval in brackets; empty for None."""
    return "" if ends is None else f" ({ends[0]:{form}} .. {ends[1]:{form}})"


def entitled(title: str, synthetic: str | None) -> str:
    """Title of a plot; the second line marks synthetic data."""
    return f"{title}\n(synthetic: {synthetic})" if synthetic else title


def commented(text: str, synthetic: str | None) -> str:
    """A TOML file; the first line marks synthetic data."""
    return (f"# synthetic: {synthetic}\n" if synthetic else "") + text


def by_chance(estimate: Estimate, names: Sequence[str]) -> Array:
    """Bounds (n,) on the effect of noise on these estimates, at the common false-alarm rate."""
    ends = [estimate.interval(name, 1 - FALSE_ALARM / len(names)) for name in names]
    return np.array([(high - low) / 2 for low, high in ends])
