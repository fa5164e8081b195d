"""The table of fitted oscillators, one row per experiment."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from .experiments import Experiment
from .frequency_modal import ModalFit
from .stiffness_result import NAMES

_UNITS = {"m": "kg", "c": "N.s/m", "k": "N/m", "fn": "Hz", "zeta": "1"}


def pose_table(experiments: Sequence[Experiment], fits: Sequence[ModalFit | None], note: str | None) -> str:
    """CSV of pose, m, c, k, fn, zeta with the ends of their 95 % intervals (noise of the records alone)."""
    out = io.StringIO()
    if note:
        out.write(f"# SYNTHETIC: {note}\n")
    writer = csv.writer(out, lineterminator="\n")
    heads = [f"{n}{end} [{_UNITS[n]}]" for n in NAMES for end in ("", "_low", "_high")]
    writer.writerow(
        ["x [m]", "y [m]", "z [m]", "A [rad]", "direction", "source", "modes", "next_mode [Hz]", *heads, "note"]
    )
    for e, f in zip(experiments, fits, strict=True):
        start = [*map(repr, e.pose.tolist()), "xyz"[e.direction], e.source]
        if f is None:
            writer.writerow([*start, 0, "", *[""] * len(heads), "no mode was found"])
            continue
        numbers = [repr(float(x)) for n in NAMES for x in (getattr(f, n)[0], *f.interval(f"{n}[0]"))]
        apart = "" if f.next_mode is None else repr(f.next_mode)
        writer.writerow([*start, len(f.m), apart, *numbers, "; ".join(f.notes)])
    return out.getvalue()
