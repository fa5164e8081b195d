"""Kind "simulation": inputs of a file, the command, and what is refused, with its key."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gtmodel import Trajectory
from gtmodel.problem_files import Context, InputError, run
from gtmodel.problem_files.load import check
from tests.support.commands import Commands, process
from tests.support.own_models import FILES

G, L, M = 9.81, 0.5, 1.0  # of the driven pendulum in own_models
SWING = {
    "kind": "simulation",
    "title": "Swing",
    "robot": "pendulum.py:Pendulum",
    "final_time_s": 1.0,
    "step_s": 0.01,
    "tolerance": 1e-11,
    "start": {"phi": 0.01, "der(phi)": 0.0},
    "inputs": {"tau": 0.0},
}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def solve(context: Context | None = None, **changes: object):
    kind, problem = check({**SWING, **changes})
    with run.keyed(SimpleNamespace(kind=kind, placed=lambda error: error)):  # type: ignore[arg-type]
        return kind.call(problem, context or Context())()  # type: ignore[attr-defined]


def explained(**changes: object) -> str:
    kind, problem = check({**SWING, **changes})
    return kind.explain(problem, Context())  # type: ignore[attr-defined]


class TestInputs:
    def csv(self, here: Path, name: str = "torque.csv", signal: str = "tau", unit: str = "N.m") -> str:
        t = np.linspace(0.0, 1.0, 51)
        Trajectory(t, {signal: np.sin(5 * t)}, {signal: unit}).to_csv(here / name)
        return name

    def test_a_file_drives(self, here: Path) -> None:
        context = Context(folder=here)
        outcome = solve(context, inputs={"tau": {"file": self.csv(here), "interpolation": "cubic"}}, start={"phi": 0.0})
        assert outcome.trajectory is not None
        assert outcome.trajectory["tau"] == pytest.approx(np.sin(5 * outcome.trajectory.time), abs=1e-5)
        assert context.inputs["inputs.tau"] == here / "torque.csv"

    def test_another_name_in_the_file_and_held_rows(self, here: Path) -> None:
        name = self.csv(here, signal="moment")
        inputs = {"tau": {"file": name, "signal": "moment", "interpolation": "previous"}}
        outcome = solve(Context(folder=here), inputs=inputs)
        assert outcome.trajectory is not None
        assert len(set(outcome.trajectory["tau"].tolist())) == 50 + 1 - 1

    @pytest.mark.parametrize(
        ("inputs", "key"),
        [
            ({"tau": {"file": "none.csv"}}, "inputs.tau.file"),
            ({"tau": {"file": "torque.csv", "signal": "x"}}, "inputs.tau.file"),
            ({"tau": {"file": "pendulum.py"}}, "inputs.tau.file"),
            ({"tao": 0.0}, "inputs.tao"),
            ({"tau": {"file": "torque.csv", "interpolation": "quintic"}}, "inputs.tau.interpolation"),
            ({"tau": {"path": "a.csv"}}, "inputs.tau"),
            ({"tau": {}}, "inputs.tau"),
            ({"tau": math.inf}, "inputs.tau"),
            ({"tau": "torque.csv"}, "inputs.tau"),
            ({"tau": [0.0, "x"]}, "inputs.tau"),
        ],
    )
    def test_wrong_inputs(self, here: Path, inputs: dict[str, object], key: str) -> None:
        self.csv(here)
        with pytest.raises(InputError) as caught:
            solve(Context(folder=here), inputs=inputs)
        assert caught.value.key == key and caught.value.message

    def test_a_file_in_another_unit(self, here: Path) -> None:
        with pytest.raises(InputError, match=r"input 'tau' is in N\.m; found m") as refused:
            solve(Context(folder=here), inputs={"tau": {"file": self.csv(here, unit="m")}})
        assert refused.value.key == "inputs.tau"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"start": {"phi": 0.0, "ph": 1.0}}, "start.ph"),
        ({"outputs": ["phi", "omega"]}, "outputs[1]"),
        ({"keep": ["phi", "omega"]}, "keep[1]"),
        ({"prefer": ["x"]}, "prefer[0]"),
        ({"step_s": 2.0}, "step_s"),
        ({"max_step_s": 1e-9}, "max_step_s"),
        ({"max_step_s": 0.0}, "max_step_s"),
        ({"final_time_s": 0.0}, "final_time_s"),
        ({"method": "euler"}, "method"),
        ({"tolerance": 1.0}, "tolerance"),
        ({"start": {"phi": "left"}}, "start.phi"),
        ({"begin": {}}, "begin"),
    ],
)
def test_wrong_problems(changes: dict[str, object], key: str) -> None:
    with pytest.raises(InputError) as caught:
        solve(**changes)
    assert caught.value.key == key and caught.value.message


def test_there_is_nothing_to_start_from() -> None:
    with pytest.raises(InputError, match=r"--start: a simulation starts at its \[start\]"):
        solve(Context(start={"kind": "simulation"}))


def test_explain() -> None:
    told = explained()
    assert told.startswith("Swing: 1 s\nPendulum: simulation by CVODES (bdf), tolerance 1e-11\n  prescribed: tau\n")
    assert "phi = 0.01  prescribed" in told and "pendulum.py:" in told
    assert "der(phi) = 0  chosen by the initialisation" in explained(start={})


class TestCommand:
    """`gtmodel solve`, with the shipped problem and a person's own."""

    @pytest.fixture
    def gtmodel(self, capsys: pytest.CaptureFixture[str]) -> Commands:
        return Commands(capsys)

    def toml(self, here: Path, **changes: str) -> str:
        lines = ['kind = "simulation"', 'robot = "pendulum.py:Pendulum"', "final_time_s = 0.5", *changes.values()]
        (here / "own.toml").write_text("\n".join([*lines, "[start]", "phi = 1.0", "[inputs]", "tau = 0.0"]))
        return "own.toml"

    def test_the_drop_is_solved_plotted_and_the_same_in_two_processes(self, here: Path) -> None:
        written = []
        for seed in ("1", "2"):
            done = process(
                "solve",
                "problems/l1_drop.toml",
                "--json",
                "--plot",
                "--out",
                f"drop{seed}",
                cwd=here,
                PYTHONHASHSEED=seed,
            )
            assert done.code == 0 and done.json["status"] == "solved"
            assert all(check["passed"] for check in done.json["checks"].values())
            folder = here / f"drop{seed}"
            written.append({p.name: p.read_bytes() for p in folder.iterdir() if p.name != "run.toml"})
        assert sorted(written[0]) == ["energy.png", "result.json", "signals.png", "trajectory.csv"]
        assert written[0] == written[1]
        read = Trajectory.from_csv(here / "drop1" / "trajectory.csv")
        assert read["T"][0] == pytest.approx([0.5, -0.9, 0.3], abs=1e-12) and read["T"][-1, 2] < 0.29
        assert json.loads(written[0]["result.json"])["trajectory"]["units"]["T"] == "m"

    def test_solved_and_shown(self, here: Path, gtmodel: Commands) -> None:
        done = gtmodel("solve", self.toml(here))
        assert done.code == 0 and done.err == ""
        assert "phi at the end" in done.out and "phi, der(phi)" in done.out

    def test_not_solved(self, here: Path, gtmodel: Commands) -> None:
        (here / "growing.py").write_text(
            "import gtmodel as gt\n\n\nclass Growing(gt.Model):\n"
            '    phi = gt.variable(unit="1")\n    tau = gt.input(unit="1")\n    s = gt.parameter(1.0, unit="s")\n\n'
            "    def equations(self):\n        yield self.s * gt.der(self.phi) == self.phi**2 + self.tau\n"
        )
        done = gtmodel(
            "solve", self.toml(here), "--set", "robot=growing.py:Growing", "--set", "final_time_s=2", "--json"
        )
        assert done.code == 1 and done.json["status"] == "diverged" and "grows without bound" in done.sentence
        assert 0.9 < done.json["values"]["end_time_s"] < 1.0

    def test_bad_input(self, here: Path, gtmodel: Commands) -> None:
        done = gtmodel("solve", self.toml(here), "--set", "start.phi=left")
        assert done.code == 2 and done.sentence.startswith("own.toml: start.phi: expected")
        done = gtmodel("solve", self.toml(here), "--set", 'inputs.tau={file="none.csv"}')
        assert done.code == 2 and "none.csv" in done.sentence

    def test_a_start_that_contradicts_itself(self, here: Path, gtmodel: Commands) -> None:
        done = gtmodel("solve", "problems/l1_drop.toml", "--set", "start.q=[0.0, 0.0, 0.0]")
        assert done.code == 2 and "no consistent start was found with the prescribed q[0] = 0" in done.err


class TestEvents:
    """The shipped mass on a belt, whose pieces are harmonic or straight."""

    @pytest.fixture
    def gtmodel(self, capsys: pytest.CaptureFixture[str]) -> Commands:
        return Commands(capsys)

    def test_the_shipped_problem_is_exact(self, here: Path, gtmodel: Commands) -> None:
        done = gtmodel("solve", "problems/stick_slip.toml", "--plot", "--out", "belt")
        assert done.code == 0 and "at 0.5 s" in done.out and "slides 0 -> -1" in done.out
        result = json.loads((here / "belt" / "result.json").read_text())["values"]
        # it slips at 5 N / 100 N/m; slipping it is a harmonic of 10 rad/s about 3 N / 100 N/m, until it has the belt's
        # speed again
        slip = 2 * (math.pi - math.atan(10 * (0.05 - 0.03) / 0.1)) / 10
        end = 0.03 + 0.02 * math.cos(10 * slip) + 0.01 * math.sin(10 * slip)
        stick = (0.05 - end) / 0.1
        times = [0.5 + k * (slip + stick) + half for k in range(6) for half in (0.0, slip)]
        assert [e["time_s"] for e in result["events"]] == pytest.approx(times, abs=1e-9)
        assert [e["changes"]["slides"] for e in result["events"]] == [[0.0, -1.0], [-1.0, 0.0]] * 6
        assert "models/stick_slip.py:" in result["events"][0]["causes"][0]
        assert result["accumulation_s"] is None
        rows = (here / "belt" / "events.csv").read_text().splitlines()
        assert rows[0] == "time [s],causes,changes,energy [J]" and len(rows) == 13
        assert rows[1].endswith("slides 0 -> -1,0")

    def test_a_discrete_variable_is_given_in_start(self, here: Path, gtmodel: Commands) -> None:
        done = gtmodel(
            "solve", "problems/stick_slip.toml", "--set", "start.slides=-1", "--set", "start.x=0.05", "--json"
        )
        assert done.code == 0
        slip = 2 * (math.pi - math.atan(10 * (0.05 - 0.03) / 0.1)) / 10
        assert done.json["values"]["events"][0]["time_s"] == pytest.approx(slip, abs=1e-9)
        done = gtmodel("solve", "problems/stick_slip.toml", "--set", "start.slides=[0.0,1.0]")
        assert done.code == 2 and "'slides' has shape" in done.err

    def test_samples_are_a_file_and_an_accumulation_is_one_sentence(self, here: Path, gtmodel: Commands) -> None:
        (here / "ball.py").write_text(
            "import gtmodel as gt\n\n\nclass Look(gt.SampledBlock):\n"
            "    height = gt.input(unit='m')\n    seen = gt.output(0.0, unit='m')\n\n"
            "    def step(self, inputs, state):\n        return {'seen': inputs.height}\n\n\n"
            "class Ball(gt.Model):\n    phi = gt.variable(unit='m', start=1.0)\n    v = gt.variable(unit='m/s')\n"
            "    tau = gt.input(unit='m/s2')\n    look = gt.part(Look, period=0.1)\n\n"
            "    def equations(self):\n        yield gt.der(self.phi) == self.v\n"
            "        yield gt.der(self.v) == -9.81 + self.tau\n        yield self.look.height == self.phi\n"
            "        yield gt.when(self.phi <= 0, gt.reinit(self.v, -0.8 * self.v))\n"
        )
        changes = ["robot=ball.py:Ball", "start={phi=1.0,v=0.0}", "final_time_s=5"]
        given = [word for change in changes for word in ("--set", change)]
        done = gtmodel("solve", TestCommand().toml(here), *given, "--out", "fallen")
        assert done.code == 1 and "events accumulate at 4.0637" in done.out + done.err
        result = json.loads((here / "fallen" / "result.json").read_text())["values"]
        assert result["accumulation_s"] == pytest.approx(4.06371, abs=1e-5)
        samples = Trajectory.from_csv(here / "fallen" / "samples_look.csv")
        assert samples.time[:3] == pytest.approx([0.0, 0.1, 0.2], abs=1e-15)
        assert samples["height"][1] == pytest.approx(1 - 9.81 * 0.01 / 2, abs=1e-9)
