"""What a learning study answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...results import Quantity, Row, Study

Numbers = Sequence[float]
Courses = Sequence[Sequence[float]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LearningStudy(Study):
    """Runs of a learning law beside what was said of them beforehand, per axis; errors are root mean squares over the
    fully corrected samples. trajectory: reference, input and estimate of the last run."""

    case: Annotated[str, "what is learned from: 1, 2A, 2B, 3"] = ""
    axes: Annotated[Sequence[str], "names, in the order of all that follows"] = ()
    shift: Annotated[Sequence[int], Quantity("", "of L in samples", key="shift_samples")] = ()
    sigma: Annotated[Numbers, "largest singular value of (7.16), by the model"] = ()
    bound: Annotated[Numbers, "largest |Q| |1 - L T| over frequency and all models"] = ()
    bound_frequency: Annotated[Numbers, Quantity("Hz", "where that is")] = ()
    first_error: Annotated[Numbers, Quantity("m", "of the estimate, before learning", written="um")] = ()
    floor: Annotated[Numbers, Quantity("m", "predicted before learning", written="um")] = ()
    factor: Annotated[Numbers, "by which the error is to fall, predicted before learning: first error over floor"] = ()
    not_learned: Annotated[Numbers, "share of the first error that Q does not let through, predicted"] = ()
    scatter: Annotated[Numbers, Quantity("m", "part of the floor that does not repeat, predicted", written="um")] = ()
    reached: Annotated[Numbers, Quantity("m", "error of the estimate over the last runs", written="um")] = ()
    error: Annotated[Courses, Quantity("m", "of the estimate, per axis in each run", written="um")] = ()
    predicted: Annotated[Courses, Quantity("m", "the same, predicted before learning", written="um")] = ()
    tool_error: Annotated[
        Courses | None, Quantity("m", "of the true tool, per axis in each run; where it is known", written="um")
    ] = None
    tool_share: Annotated[Numbers | None, "tool's error over the last runs, of that before learning"] = None
    reference_above: Annotated[Numbers, "share of the first error's amplitude above the cutoff of Q"] = ()
    largest_input: Annotated[Numbers, Quantity("m", "modulus of the learned input", written="mm")] = ()
    synthetic: Annotated[str | None, "what made the runs; null for measured ones"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("learned from", WORDS.get(self.case, self.case))]
        for k, axis in enumerate(self.axes):
            rows.append(Row(f"{axis}: rate", f"sigma {self.sigma[k]:.3f}; all models {self.bound[k]:.3f} at "
                            f"{self.bound_frequency[k]:.3g} Hz"))  # fmt: skip
            if not self.floor:  # ended before there was one
                continue
            rows.append(Row(f"{axis}: error before learning", f"{1e6 * self.first_error[k]:.4g}", "um"))
            falls = f" (falls to 1/{self.factor[k]:.3g})" if self.factor and np.isfinite(self.factor[k]) else ""
            rows.append(Row(f"{axis}: floor predicted", f"{1e6 * self.floor[k]:.4g}{falls}", "um"))
            if self.reached:
                rows.append(Row(f"{axis}: reached", f"{1e6 * self.reached[k]:.4g}", "um"))
            if self.tool_share is not None:
                rows.append(Row(f"{axis}: tool's error left", f"{100 * self.tool_share[k]:.3g}", "%"))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])


WORDS = {
    "1": "the motors (case 1)", "2A": "a complementary filter (case 2A)", "2B": "a Kalman filter (case 2B)",
    "3": "the measured tool (case 3)",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class NextInputStudy(Study):
    """The input for the next run, and what learning will leave; errors are root mean squares of the fully corrected
    samples."""

    axes: Annotated[Sequence[str], "names, in the order of all that follows"] = ()
    case: Annotated[str, "what is learned from: 1, 2A, 2B, 3"] = ""
    error: Annotated[Sequence[float], Quantity("m", "of the estimate in this run", written="um")] = ()
    floor: Annotated[Sequence[float], Quantity("m", "what learning will leave, by the model", written="um")] = ()
    scatter: Annotated[
        Sequence[float] | None, Quantity("m", "between identical runs, learning on; null without them", written="um")
    ] = None
    unexplained: Annotated[
        Sequence[float], "what the model does not make of this run, of the error that it expects before learning"
    ] = ()
    sigma: Annotated[Sequence[float], "largest singular value of (7.16), by the model"] = ()
    bound: Annotated[Sequence[float], "largest |Q| |1 - L T| over frequency and all models"] = ()
    learned: Annotated[bool, "whether nothing more can be learned; the input is then that of this run"] = False
    largest_input: Annotated[Sequence[float], Quantity("m", "modulus of the next input", written="mm")] = ()
    synthetic: Annotated[str | None, "what made a synthetic run; null for a measured one"] = None

    @property
    def rows(self) -> list[Row]:
        """The table for people."""
        rows = [Row("learned from", WORDS.get(self.case, self.case))]
        for k, axis in enumerate(self.axes):
            rows.append(Row(f"{axis}: error of this run", f"{1e6 * self.error[k]:.4g}", "um"))
            rows.append(Row(f"{axis}: floor", f"{1e6 * self.floor[k]:.4g}", "um"))
            rows.append(Row(f"{axis}: rate", f"sigma {self.sigma[k]:.3f}; all models {self.bound[k]:.3f}"))
        return rows + ([Row("SYNTHETIC", self.synthetic)] if self.synthetic else [])
