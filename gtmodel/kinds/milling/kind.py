"""Kind "milling": where to mill, by static and dynamic deflection over the angle about the spindle."""

from __future__ import annotations

import numpy as np

from gtmodel.milling import study
from gtmodel.milling.task import task_of
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.call import Call
from gtmodel.problem_files.from_options import options_of
from gtmodel.robots.kr500 import kr500_tables

from .keys import SOURCES, Schema

NAME = "milling"


def arguments(problem: Schema) -> dict[str, str]:
    """Where the study's arguments stand in the file."""
    source = next((k for k in SOURCES if getattr(problem, k) is not None), "")
    return {
        "speed": "cut.speed_rpm",
        "feed": "cut.feed_direction",
        "search.speeds": "search.speeds_rpm",
        "cutter.coefficients": "cutter",
        "dynamics": source,
        "lobes": "lobes.to_rpm" if source else "lobes",
    }


def call(problem: Schema, context: Context) -> Call:
    """The study of the declared place, and of what it is compared with."""
    limits, lobes = problem.limits_deg, problem.lobes
    made = options_of(problem, "cutter", "cut", "tool", "search", "compensation")
    return Call(
        study, problem.model(context), made.pop("cutter"), made.pop("cut"), place=problem.place_m,
        speed=problem.cut.speed_rpm / 60, feed=problem.cut.feed_direction,
        joint_stiffness=[1e6 * k for k in problem.joint_stiffness_MNm_rad], **made,
        dynamics=problem.dynamics(context), source=problem.oscillator_field or "",
        limits=limits and [np.deg2rad(row).tolist() for row in limits],
        lobes=lobes and (lobes.from_rpm / 60, lobes.to_rpm / 60),
        tests=kr500_tables() if problem.printed_tests else None, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """What will be compared."""
    made = call(problem, context)
    later = ("lobes", "compensation", "tests")
    task = task_of(*made.arguments, **{k: v for k, v in made.options.items() if k not in later})
    s, lag = task.search, np.rad2deg(task.cutter.lag(task.cut.axial_depth))
    counts = [1 + len(x) for x in (s.places, s.feed_directions, s.speeds)]
    return "\n".join(
        [
            f"{problem.title or NAME}: {round(2 * np.pi / s.step) + 1} angles, {counts[0]} places, {counts[1]} feeds, "
            f"{counts[2]} speeds",
            f"{task.cut.mode} milling with {task.cutter.teeth} teeth at {task.speed * task.cutter.teeth:.4g} Hz; the "
            f"helix lags by {lag:.3g} deg over the depth",
            "forces by Cvitanic 2021, eqs. (12)-(17); static index |K^-1 F_peak| (18), dynamic index max |x(t)| (19)",
            f"dynamics: {task.whence or 'none, static index only'}",
        ]
    )
