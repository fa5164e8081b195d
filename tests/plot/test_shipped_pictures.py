"""Every picture of every shipped problem: units on its axes, no text on another, colours of the palette, same bytes."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from gtmodel.plot.style import with_panels
from gtmodel.problem_files import run
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load
from gtmodel.results.written import png
from tests.support.picture_faults import faults
from tests.support.recordings import NOT_SHIPPED

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
QUICK = (
    "compliance_kr500", "f1_modes", "friction_l1", "l1_drop", "table_6_1", "van_der_pol",
    "vibration_step",
)  # fmt: skip
NO_PICTURE = (  # they write code
    "d1_controller", "f1_controller", "f1_fmu", "five_bar_controller", "l1_controller", "l1_controller_float", "l1_fmu",
    "l1_inverse_fmu", "l1_lead_through", "l1_predictive", "planar_3rrr_controller", "predictive_path",
    "rotary_delta_controller",
)  # fmt: skip
ELSEWHERE = tuple(NOT_SHIPPED)  # their recordings are not shipped
OTHERS = sorted({p.stem for p in PROBLEMS.glob("*.toml")} - {*QUICK, *NO_PICTURE, *ELSEWHERE})


@cache
def pictures(name: str) -> dict[str, Any]:
    context = Context(folder=PROBLEMS)
    return dict(run.solve(load(PROBLEMS / f"{name}.toml"), context).outcome.figures)


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(n, marks=pytest.mark.proof) for n in OTHERS)])
def test_a_picture_says_what_it_shows(name: str) -> None:
    drawn = pictures(name)
    assert drawn
    assert {n: said for n, draw in drawn.items() if (said := faults(draw()))} == {}


@pytest.mark.parametrize("name", [pytest.param("calibrate_l1", marks=pytest.mark.proof), "l1_drop", "vibration_step"])
def test_the_same_picture_has_the_same_bytes(name: str) -> None:
    import matplotlib as mpl

    for draw in pictures(name).values():
        before = png(draw)
        with mpl.rc_context({"lines.linewidth": 9, "font.size": 20, "axes.grid": True}):  # a person's own settings
            assert png(draw) == before


def _good() -> tuple[Figure, Any]:
    figure, (axes,) = with_panels(4.0, 3.0, title="a picture")
    axes.plot([0, 1], [0, 1], color="black", label="line")
    axes.set(xlabel="time [s]", ylabel="position [m]", title="a panel")
    return figure, axes


def test_faults_are_seen() -> None:
    figure, axes = _good()
    assert faults(figure) == []
    axes.set_ylabel("position")
    assert faults(figure) == ["axis y of 'a panel' is called 'position', without a unit"]
    figure, axes = _good()
    axes.plot([0, 1], [1, 0], color="red", label="line")
    axes.legend()
    assert faults(figure) == ["legend holds 'line' 2 times", "colour red is not of the palette"]
    figure, axes = _good()
    axes.text(0.5, 0.5, "here")
    axes.text(0.52, 0.5, "there")
    axes.text(3.0, 0.5, "far away").set_in_layout(False)
    assert faults(figure) == ["'far away' leaves the picture", "'there' lies on 'here'"]
    figure, pair = with_panels(6.0, 3.0, columns=2)
    for panel in pair:
        panel.set(xlabel="time [s]", ylabel="position [m]", title="twice")
        panel.contourf(np.eye(3))
    figure.colorbar(pair[0].contourf(np.eye(3)), ax=pair[0], label="height")
    assert faults(figure) == ["a scale of colours is called 'height'", "2 panels are called 'twice'"]
