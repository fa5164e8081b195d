"""Trajectories that the tests of their reading, their files and their errors share."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings, strategies as st

from gtmodel.results import Trajectory

TIME = [0.0, 0.1, 0.3, 0.6]
ROUNDING = 1e-12  # relative; interpolation weights round a few times


def example(**changes: Any) -> Trajectory:
    """A vector and two scalar signals over four rows."""
    arguments: dict[str, Any] = {
        "time": TIME,
        "values": {
            "T": [[0.0, 1.0, -2.0], [0.5, 1.0, -2.5], [1.0, 1.0, -3.0], [1.5, 1.0, -7.25]],
            "arm[0].rod.tension": [1.0, -20.0, 3.0, 4.0],
            "count": [0, 1, 2, 3],
        },
        "units": {"T": "m", "arm[0].rod.tension": "N/m"},
        "title": "Point to point",
        "provenance": {"robot": "l1_tape", "limits": {"force_N": 500.0}, "seeds": [1, 2]},
        "synthetic": "seed 3, 10 um noise",
    }
    arguments.update(changes)
    return Trajectory(arguments.pop("time"), arguments.pop("values"), arguments.pop("units"), **arguments)


finite = st.floats(allow_nan=False, allow_infinity=False)
moderate = st.floats(min_value=-1e6, max_value=1e6)
eighths = st.integers(-1000, 1000).map(lambda i: i / 8)
AWKWARD = [
    "x",
    "x[0]",
    "x[1]",
    "x[0][2]",
    "x[01]",
    "time[0]",
    "der(x)",
    "arm[0].x",
    "Δω'",
    "title:",
    "x#",
    "[0]",
]
AWKWARD_NOTES = ["", "{}", "a: b, c", "# title: x", "ñ–²", '"quoted"']
ORIGINS: list[dict[str, Any]] = [{}, {"b": [1, 0.1, None], "a": {"ü": "line\nbreak"}}]
quick = settings(
    max_examples=30,
    deadline=None,  # scipy is imported on first use
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # files of one test share a folder
)


@st.composite
def trajectories(draw: st.DrawFn, number: st.SearchStrategy[float] = finite) -> Trajectory:
    """Any trajectory of up to four rows: awkward names and notes, scalar and vector signals."""
    time = sorted(draw(st.lists(number, min_size=1, max_size=4, unique=True)))
    values: dict[str, Any] = {}
    taken: set[str] = set()
    for name in draw(st.lists(st.sampled_from(AWKWARD), min_size=1, max_size=4, unique=True)):
        k = draw(st.integers(0, 3))
        own = {name, *(f"{name}[{i}]" for i in range(k))}
        if not own & taken:
            taken |= own
            count = len(time) * max(k, 1)
            data = np.array(draw(st.lists(number, min_size=count, max_size=count)))
            values[name] = data.reshape(len(time), k) if k else data
    return Trajectory(
        time,
        values,
        {name: draw(st.sampled_from(["m", "N.m", "rad/s", "1", "N m", ""])) for name in values},
        title=draw(st.sampled_from(AWKWARD_NOTES)),
        provenance=draw(st.sampled_from(ORIGINS)),
        synthetic=draw(st.sampled_from([None, *AWKWARD_NOTES[1:]])),
    )
