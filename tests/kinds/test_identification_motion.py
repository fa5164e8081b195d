"""A file's motion in place of the sines: an excitation's trajectory.csv identifies the L1; what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import multisine
from gtmodel.kinds import identification
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from tests.identify.plants import BAND, SAMPLE_TIME, plant

PERIOD = 8.0  # s
FILE = ["synthetic.reference_file=trajectory.csv", "synthetic.duration_s=12"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """trajectory.csv as an excitation writes it: a closed motion of the tool, and other columns."""
    time = SAMPLE_TIME * np.arange(round(PERIOD / SAMPLE_TIME) + 1)
    T = multisine(time, np.asarray(plant().home, dtype=float), np.full(3, 0.3), np.array(BAND), seed=9)
    signals = {"T": T, "tau": np.zeros((len(time), 3))}
    gt.Trajectory(time, signals, {"T": "m", "tau": "N"}, title="closed").to_csv(tmp_path / "trajectory.csv")
    return tmp_path


def solve(folder: Path, *settings: str):
    context = Context(folder=folder)
    return identification.solve(load("problems/inertia_l1.toml", [*FILE, *settings]).problem, context), context


def test_the_motion_of_a_file_runs_several_times(folder: Path):
    outcome, context = solve(folder, "synthetic.repeats=2")
    assert all(check.passed for check in outcome.checks.values()), outcome.checks
    assert context.inputs["synthetic.reference_file"].name == "trajectory.csv"
    assert outcome.trajectory is not None
    # the ends cut by the filter are half a second each; the sines of the held-out motion are 12 s long
    assert 2 * PERIOD - 2.0 < outcome.trajectory.time[-1] < 2 * PERIOD
    assert outcome.values["parameters"]["m_p"] == pytest.approx(9.13, abs=0.6)


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        (["synthetic.reference_file=no.csv"], "synthetic.reference_file: there is no file 'no.csv'"),
        (["synthetic.reference=q"], r"synthetic.reference_file: .*no column 'q'"),
        (["synthetic.sample_time_s=0.008"], "synthetic.reference_file: .*4 ms apart; expected 8 ms"),
        (["synthetic.reference_file=open.csv", "synthetic.repeats=2"], "synthetic.repeats: .*ends 0.1 m from where"),
        (["synthetic.reference_file=far.csv"], "synthetic.reference_file: the motion leaves the reach .* at 0 s"),
    ],
)
def test_wrong_files(folder: Path, settings: list[str], sentence: str):
    read = gt.Trajectory.from_csv(folder / "trajectory.csv")
    way = np.linspace(0, 0.1, len(read))[:, None] * np.ones(3)
    for name, T in (("open.csv", read["T"] + way), ("far.csv", read["T"] + 5.0)):
        gt.Trajectory(read.time, {"T": T}, {"T": "m"}).to_csv(folder / name)
    with pytest.raises(InputError, match=sentence):
        solve(folder, *settings)
