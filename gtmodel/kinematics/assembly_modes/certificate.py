"""What the search for the modes of one pose did and found, in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Certificate:
    """Evidence that the set of modes is whole.

    Attributes:
        paths: paths of one start system, 40.
        finite: finite modes over the complex numbers, none multiple.
        distinct: those of them that lie outside the radius of uniqueness of every other; as many as `finite`.
        certified: how many of them pass the Newton-Kantorovich test (one solution near, no other within a radius).
        real: real modes among them.
        conjugate_pairs: pairs of complex conjugate modes among them; real + 2 conjugate_pairs = finite when whole.
        infinite: paths of the last start system that ended at infinity (x.x = 0).
        multiple: paths of the last start system that ended in finite modes where the equations are singular.
        lost: paths of the last start system that ended nowhere, or twice in the same regular mode.
        start_systems: start systems used, 1 when the first sufficed.
        retries: paths tracked again from another start system.
        steps_mean, steps_most: steps per path.
        worst_residual: largest scaled equation |F(z)| with |z| = 1 over the found modes; 1 is the size of the terms.
        worst_closure: largest error of a leg length over the real modes, relative to the platform's size.
        worst_condition: largest condition number of the equations at a found mode.
        least_separation: smallest distance of two found modes as points of projective space; at most 1.
        nearest_distance: over the real modes, distance of the platform joints' centroid between the two that are
            nearest each other (`AssemblyModes.nearest_other`), in the unit of the input; infinite with fewer than two.
        nearest_angle_deg: the angle between these two [deg].
    """

    paths: int = 40
    finite: int = 0
    distinct: int = 0
    certified: int = 0
    real: int = 0
    conjugate_pairs: int = 0
    infinite: int = 0
    multiple: int = 0
    lost: int = 0
    start_systems: int = 0
    retries: int = 0
    steps_mean: float = 0.0
    steps_most: int = 0
    worst_residual: float = 0.0
    worst_closure: float = 0.0
    worst_condition: float = 0.0
    least_separation: float = np.inf
    nearest_distance: float = np.inf
    nearest_angle_deg: float = np.inf

    def text(self, *, unit: str = "m") -> str:
        """The certificate as lines for a person; ``unit`` is that of the input, metres are shown as millimetres."""
        factor, shown = (1000.0, "mm") if unit == "m" else (1.0, unit)
        lines = [
            ("modes found", f"{self.finite} of {self.paths}, {self.distinct} distinct, {self.certified} certified"),
            ("real", f"{self.real}, and {self.conjugate_pairs} conjugate pairs"),
            ("elsewhere", f"{self.infinite} at infinity, {self.multiple} multiple, {self.lost} lost"),
            ("worst residual", f"{self.worst_residual:.1e} scaled; leg lengths {self.worst_closure:.1e}"),
            ("condition", f"{self.worst_condition:.1e}; least separation {self.least_separation:.1e}"),
            (
                "nearest modes",
                f"{self.nearest_distance * factor:.3f} {shown} and {self.nearest_angle_deg:.3f} deg apart",
            ),
            ("start systems", f"{self.start_systems}, {self.retries} paths tracked again"),
            ("steps per path", f"{self.steps_mean:.0f} mean, {self.steps_most} most"),
        ]
        if self.real < 2:
            del lines[5]
        return "\n".join(f"{name:<15} {value}" for name, value in lines)
