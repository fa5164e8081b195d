"""Kind "excitation": its files on the command line, and where refusals stand in the file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.registry import results_of
from gtmodel.problem_files.run import answer
from gtmodel.results import Trajectory
from gtmodel.results.quantity import described
from tests.support.commands import CLONE, Commands

L1 = CLONE / "problems" / "excitation_l1.toml"
ROUNDING = 1e-9


class TestCommandLine:
    def test_files_pictures_and_values(self, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
        (tmp_path / "e.toml").write_text(
            'kind = "excitation"\nrobot = "l1_tape"\n[motion]\nperiod_s = 2.0\nharmonics = 2\n'
            "place_low_m = [0.9, -0.9, 0.4]\nplace_high_m = [1.1, -0.7, 0.6]\n[limits]\nforce_N = 700.0\n"
            "tcp_low_m = [0.5, -1.1, 0.2]\ntcp_high_m = [1.5, -0.5, 0.8]\n"
            '[random]\ndraws = 3\n[search]\ncriterion = "variance"\nmax_iterations = 100\n'
        )
        commands = Commands(capsys)
        done = commands("solve", tmp_path / "e.toml", "--json", "--plot", "--out", tmp_path / "one")
        assert done.code == 0 and list(done.json["values"]) == list(described(*results_of("excitation")))
        names = {"result.json", "trajectory.csv", "run.toml", "motion.png", "information.png", "workspace.png"}
        assert {p.name for p in (tmp_path / "one").iterdir()} == names
        assert commands("solve", tmp_path / "e.toml", "--out", tmp_path / "two").code == 0
        for name in ("result.json", "trajectory.csv"):
            assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
        # from its own result the search has little left to gain
        again = commands("solve", tmp_path / "e.toml", "--json", "--start", tmp_path / "one" / "result.json",
                         "--out", tmp_path / "three")  # fmt: skip
        assert again.code == 0 and again.json["objective"] <= done.json["objective"] + ROUNDING
        (tmp_path / "motion.toml").write_text(
            'kind = "simulation"\nrobot = "l1_tape"\nfinal_time_s = 0.1\n[start]\n'
            f"T = {json.loads((tmp_path / 'one' / 'result.json').read_text())['trajectory']['values']['T'][0]}\n"
            '"der(T)" = [0.0, 0.0, 0.0]\n[inputs]\ntau = {file = "one/trajectory.csv", interpolation = "cubic"}\n'
        )
        run = commands("solve", tmp_path / "motion.toml", "--json")
        end = Trajectory.from_csv(tmp_path / "one" / "trajectory.csv")(0.1, "T")
        assert run.code == 0
        np.testing.assert_allclose(
            run.json["values"]["end"]["T"], end, atol=1e-5
        )  # forces between rows: h^4 of splines

    def test_explain(self, capsys: pytest.CaptureFixture[str]) -> None:
        done = Commands(capsys)("explain", L1)
        assert done.code == 0
        assert "13 parameters" in done.out and "9 unknowns for each of 3 coordinates" in done.out
        assert "checked at 20 times as many" in done.out


FEW = ["random.draws=2", "monte_carlo.runs=0"]
CONE = 'limits.joint_cones=[{arm = 5, end = "cart", axis = [1.0, 0.0, 0.0], half_angle_deg = 9.0}]'


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (['identified=["m_q"]'], "identified"),
        (["motion.place_low_m=[2.0, 0.0, 0.0]"], "motion.place_low_m"),
        (["motion.period_s=1.9999"], "motion.period_s"),
        ([CONE], "limits.joint_cones[0].arm"),
        (["limits.force_N=0.0"], "limits.force_N"),
    ],
)
def test_wrong_input_names_its_key(settings: list[str], key: str) -> None:
    with pytest.raises(InputError) as caught:
        answer(load(L1, [*FEW, *settings]), Context())
    assert caught.value.key == key and caught.value.message


def test_another_problems_result_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        answer(load(L1, FEW), Context(start={"values": {"unknowns": [[9.0] * 3] * 9}}))
    assert caught.value.key == "--start"
