"""report.html: what a reader sees, and that the script reads the values that were drawn."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.plot.style import with_panels
from gtmodel.results import SolveStatus, Study, at_most
from gtmodel.results.page import page as made
from gtmodel.results.page.page import Asked, PageTable, page
from gtmodel.results.quantity import Row
from tests.support.pages import SVG, drawn_in, faults_of, read

TIME = np.linspace(0.5, 2.0, 40)
FORCE = 10.0 ** (3 * np.sin(TIME))
DIGITS = 1e-5  # an SVG has six decimals of a point, of some 300 along an axis


def curve(points: int = 40) -> Callable[[], Any]:
    def draw() -> Any:
        figure, (above, below) = with_panels(5.0, 4.0, rows=2, title="a < b & c", sharex=True)
        time = np.linspace(0.5, 2.0, points)
        above.plot(time, 10.0 ** (3 * np.sin(time)), label="force", path_effects=None)
        above.set(yscale="log", ylabel="force [N]")
        below.plot(time, np.cos(7 * time), ".-", label="_hidden")
        below.set(xlabel="time [s]", ylabel="cosine [1]")
        return figure

    return draw


class Seen(Study):
    captions: ClassVar = {"curve": "A curve."}
    rows: ClassVar = [Row("mean", 1.0, "1"), Row("  verdict", "it fits"), Row("  largest", 2.0, "mm")]

    @property
    def sections(self):
        return {
            "More": ["A paragraph.", ["one", "two"], PageTable(("a", "b"), [("x < y", 1 / 3), ("z", float("nan"))])]
        }


def test_the_script_reads_what_was_drawn() -> None:
    (drawn,) = drawn_in(page(Study(status=SolveStatus.SOLVED, figures={"curve": curve()})))
    above = drawn.panels[0]
    assert above["x"][2:] == ["linear", "time [s]"] and above["y"][2:] == ["log", "force [N]"]
    ((name, label),) = above["curves"].items()
    assert label == "force"
    (group,) = [g for g in drawn.svg.iter(f"{SVG}g") if g.get("id") == name]
    path = next(group.iter(f"{SVG}path")).get("d") or ""
    points = np.array([[float(x) for x in pair] for pair in re.findall(r"[ML] (\S+) (\S+)", path)])
    left, top, right, bottom = above["box"]
    x = above["x"][0] + (points[:, 0] - left) / (right - left) * (above["x"][1] - above["x"][0])
    low, high = above["y"][:2]
    y = low * (high / low) ** ((bottom - points[:, 1]) / (bottom - top))
    assert np.allclose(x, TIME[np.argmin(abs(x[:, None] - TIME), axis=1)], rtol=DIGITS * 30)
    assert np.allclose(
        np.log(y), 3 * np.log(10) * np.sin(x), atol=1e-2
    )  # Matplotlib thins curves by a ninth of a pixel
    assert drawn.panels[1]["curves"] and set(drawn.panels[1]["curves"].values()) == {""}


def test_a_page_stands_alone_and_is_the_same_twice() -> None:
    study = Seen(
        status=SolveStatus.SOLVED, title="a < b", notes=["a & b"], figures={"curve": curve(), "second": curve()}
    )
    asked = Asked(
        what="kind: a line.",
        keys=[("robot", '"l1"', "", "a robot")],
        defaults=[("mesh", "3", "", "")],
        command="gtmodel solve x",
    )
    text = page(study, asked, "abc")
    assert faults_of(text) == [] and page(study, asked, "abc") == text and len(drawn_in(text)) == 2
    texts = [words for _, words in read(text).texts]
    assert {"a < b", "A curve.", "second", "a & b", "x < y", "0.333333", "gtmodel solve x", "abc"} <= set(texts)
    assert "Keys that the problem does not set, with their defaults: 1" in texts
    assert gt.__version__ in texts


def test_a_verdict_says_more_than_the_status() -> None:
    text = page(Seen(status=SolveStatus.SOLVED))
    assert "<li>it fits</li>" in text and SolveStatus.SOLVED.message not in text
    assert "<td>  largest</td>" in text and "<td>1</td>" not in text  # the unit of a plain number


def test_a_failed_check_is_seen_first() -> None:
    study = Study(status=SolveStatus.SOLVED, checks={"residual_m": at_most(2e-3, 1e-3, "measure again")})
    text = page(study)
    assert text.index('class="box bad"') < text.index("<h2>") and study.message in text
    assert ("td", "FAILED: measure again") in read(text).texts


def test_large_pictures_are_small_on_a_page(monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study(status=SolveStatus.SOLVED, figures={"curve": curve(60_000), "other": curve()})
    text = page(study)
    assert len(text) < 300_000 and faults_of(text) == []
    monkeypatch.setattr(made, "LARGEST", 30_000)
    both = drawn_in(page(study))
    assert all(len([*drawn.svg.iter(f"{SVG}image")]) == 1 and not [*drawn.svg.iter(f"{SVG}path")] for drawn in both)
    assert both[1].panels[0]["box"] == drawn_in(text)[1].panels[0]["box"]


def test_the_residuals_of_a_fit_are_tested_in_pictures() -> None:
    time = np.linspace(0.0, 1.0, 40)
    rows = np.column_stack([np.ones(40), time])
    noise = np.random.default_rng(1).normal(size=40)  # synthetic
    estimate = gt.inference.linear_fit(rows, rows @ [1.0, 2.0] + 0.1 * noise, ["a", "b"])
    study = Study(status=SolveStatus.SOLVED, estimate=estimate)
    (drawn,) = drawn_in(page(study))
    labels = [axis[3] for panel in drawn.panels for axis in (panel["x"], panel["y"])]
    assert {"normal quantile [1]", "autocorrelation [1]", "lag [1]"} <= set(labels) and len(drawn.panels) == 4


def test_a_motion_is_played_within_the_page() -> None:
    def beyond() -> gt.view.RobotScene:
        raise gt.results.ArgumentError("beyond the reach", "motion")

    bar = gt.view.RobotScene({"a": [0.0, 0.0, 0.0], "b": [1.0, 0.0, 0.0]}, [gt.view.VisiblePart("bar", ("a", "b"))])
    text = page(Study(status=SolveStatus.SOLVED, scenes={"motion": lambda: bar, "other": beyond}))
    assert text.count("<iframe") == 1 and "Not drawn: beyond the reach." in text and faults_of(text) == []
