"""Kind "simulation": from a file to numbers, checks and pictures; and what is refused, with its key."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gtmodel import Trajectory
from gtmodel.kinds import simulation
from gtmodel.problem_files import Context, InputError, run
from gtmodel.problem_files.load import load, validate
from gtmodel.results import SolveStatus
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
    problem = validate(simulation.Schema, {**SWING, **changes})
    return simulation.solve(problem, context or Context())


class TestNumbers:
    def test_small_swing_against_the_cosine(self) -> None:
        outcome = solve()
        w = math.sqrt(G / L)
        assert outcome.status is SolveStatus.SOLVED and outcome.trajectory is not None
        t = outcome.trajectory
        assert len(t) == 101 and t.unit("der(phi)") == "rad/s" and t.title == "Swing"
        # sin(phi) differs from phi by phi^3/6
        assert t["phi"] == pytest.approx(0.01 * np.cos(w * t.time), abs=1e-6)
        assert list(outcome.values) == list(simulation.VALUES)
        assert outcome.values["end_time_s"] == 1.0
        assert outcome.values["end"]["phi"] == t["phi"][-1]
        assert outcome.values["states"] == ["phi", "der(phi)"] and outcome.values["switches"] == 0
        assert outcome.values["chosen"] == {}
        # this model declares no energies
        assert outcome.values["energy_error_J"] is None and "energy" not in outcome.figures
        assert list(outcome.checks) == ["equations_residual"] and outcome.checks["equations_residual"].passed

    def test_what_the_file_leaves_open_is_told(self) -> None:
        outcome = solve(start={})
        assert outcome.values["chosen"] == {"phi": 0.0, "der(phi)": 0.0}
        assert ("chosen start of phi", 0.0) in [row[:2] for row in outcome.rows]

    def test_robot_with_friction_keeps_its_energy_balance(self) -> None:
        outcome = solve(
            robot="l1_tape", final_time_s=0.2, tolerance=1e-9, inputs={"tau": [0.0, 0.0, 0.0]},
            start={"T": [0.5, -0.9, 0.3], "der(T)": 0.0}, outputs=["arm[0].friction.force"],
            friction={"smoothing": "piecewise_linear", "velocity_scale_m_s": 0.01},
        )  # fmt: skip
        check = outcome.checks["energy_balance"]
        assert check.passed and check.value < 1e-6 and check.bound == 1e-4
        v = outcome.values
        assert v["energy_dissipated_J"] > 0 > v["energy_stored_J"] and v["energy_supplied_J"] == 0.0
        assert v["energy_stored_J"] + v["energy_dissipated_J"] == pytest.approx(0.0, abs=2 * v["energy_error_J"])
        assert "arm[0].friction.force" in v["end"] and len(v["end"]["T"]) == 3

    def test_a_loose_tolerance_fails_the_check_and_says_what_to_do(self) -> None:
        outcome = solve(
            robot="l1_tape", tolerance=1e-2, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3]}, final_time_s=0.2
        )
        assert outcome.status is SolveStatus.CHECK_FAILED and not outcome.checks["energy_balance"].passed
        assert "energy_balance" in outcome.message and outcome.message.endswith("; use a smaller tolerance")

    def test_states_that_change_on_the_way(self, here: Path) -> None:
        (here / "cartesian.py").write_text(
            "from tests.support.models import Pendulum\n\n\nclass Cartesian(Pendulum):\n    pass\n"
        )
        outcome = solve(robot="cartesian.py:Cartesian", start={"x": 1.0, "y": 0.0}, inputs={}, prefer=["x"])
        assert outcome.values["switches"] == 2 and "states switched 2 times" in outcome.message


class TestInputs:
    def csv(self, here: Path, name: str = "torque.csv", signal: str = "tau", unit: str = "N.m") -> str:
        t = np.linspace(0.0, 1.0, 51)
        Trajectory(t, {signal: np.sin(5 * t)}, {signal: unit}).to_csv(here / name)
        return name

    def test_a_file_drives_as_the_function_does(self, here: Path) -> None:
        context = Context(folder=here)
        w2 = G / L
        outcome = solve(context, inputs={"tau": {"file": self.csv(here), "interpolation": "cubic"}}, start={"phi": 0.0})
        assert outcome.trajectory is not None
        # phi'' + w^2 phi = sin(5 t) / (M L^2), to third order in phi
        expected = (np.sin(5.0) - 5 / math.sqrt(w2) * np.sin(math.sqrt(w2))) / (M * L**2) / (w2 - 25)
        assert outcome.trajectory["phi"][-1] == pytest.approx(expected, rel=0.1)
        assert outcome.trajectory["tau"] == pytest.approx(np.sin(5 * outcome.trajectory.time), abs=1e-5)
        assert context.inputs["inputs.tau"] == here / "torque.csv"

    def test_another_name_in_the_file_and_held_rows(self, here: Path) -> None:
        name = self.csv(here, signal="moment")
        inputs = {"tau": {"file": name, "signal": "moment", "interpolation": "previous"}}
        outcome = solve(Context(folder=here), inputs=inputs)
        assert outcome.trajectory is not None
        assert len(set(outcome.trajectory["tau"].tolist())) == 50 + 1 - 1

    @pytest.mark.parametrize(
        ("inputs", "sentence"),
        [
            ({"tau": {"file": "none.csv"}}, "inputs.tau.file: there is no file 'none.csv' in"),
            ({"tau": {"file": "torque.csv", "signal": "x"}}, "inputs.tau.file: there is no signal 'x'"),
            ({"tau": {"file": "pendulum.py"}}, "inputs.tau.file: .*line"),
            ({"tao": 0.0}, "inputs.tao: Pendulum has no variable 'tao'; did you mean 'tau'"),
            ({"tau": {"file": "torque.csv", "interpolation": "quintic"}}, "inputs.tau.interpolation: expected"),
            ({"tau": {"path": "a.csv"}}, "inputs.tau: there is no key 'path'; there are file, signal, interpolation"),
            ({"tau": {}}, r'inputs.tau: expected \{file = "motion.csv"\}'),
            ({"tau": math.inf}, "inputs.tau: expected a number or a list of numbers"),
            ({"tau": "torque.csv"}, "inputs.tau: expected a number or a list of numbers; found the text 'torque.csv'"),
            ({"tau": [0.0, "x"]}, "inputs.tau: expected a number or a list of numbers"),
        ],
    )
    def test_wrong_inputs(self, here: Path, inputs: dict[str, object], sentence: str) -> None:
        self.csv(here)
        with pytest.raises(InputError, match=sentence):
            solve(Context(folder=here), inputs=inputs)

    def test_a_file_in_another_unit(self, here: Path) -> None:
        from gtmodel import ModelError

        with pytest.raises(ModelError, match=r"input 'tau' is in N\.m; the trajectory gives it in m"):
            solve(Context(folder=here), inputs={"tau": {"file": self.csv(here, unit="m")}})


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"start": {"phi": 0.0, "ph": 1.0}}, r"start\.ph: Pendulum has no variable 'ph'; did you mean 'phi'"),
        ({"outputs": ["phi", "omega"]}, r"outputs\[1\]: Pendulum has no variable 'omega'"),
        ({"prefer": ["x"]}, r"prefer\[0\]: Pendulum has no variable 'x'"),
        ({"step_s": 2.0}, "step_s: 2 s is longer than the run of 1 s"),
        ({"step_s": 1e-9}, "step_s: 1e-09 s is too short: the run has at most 1000000 of them"),
        ({"max_step_s": 1e-9}, "max_step_s: 1e-09 s is too short: the run has at most 10000000 of them"),
        ({"max_step_s": 0.0}, "max_step_s"),
        ({"final_time_s": 0.0}, "final_time_s: must be greater than 0 s; found 0.0"),
        ({"method": "euler"}, "method: expected 'bdf' or 'adams'"),
        ({"tolerance": 1.0}, "tolerance: must be less than or equal to 0.1; found 1.0"),
        ({"start": {"phi": "left"}}, r"start\.phi: expected .*found the text 'left'"),
        ({"begin": {}}, "begin: unknown key"),
    ],
)
def test_wrong_problems(changes: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        solve(**changes)


def test_there_is_nothing_to_start_from() -> None:
    with pytest.raises(InputError, match=r"--start: a simulation begins at its \[start\]"):
        solve(Context(start={"kind": "simulation"}))


class TestRunning:
    def test_progress_and_a_request_to_stop(self) -> None:
        shown = []

        context = Context()

        def progress(stage=None, fraction=None, numbers=None):
            shown.append((stage, fraction, numbers))
            if fraction > 0.5:
                context.request_stop()

        context.progress = progress
        outcome = solve(context, step_s=0.001)
        assert outcome.status is SolveStatus.INTERRUPTED
        assert shown[0][0] == "simulating" and shown[0][2] == {"time_s": pytest.approx(shown[0][1])}
        assert outcome.trajectory is not None and 0.4 < outcome.trajectory.time[-1] < 0.7
        assert outcome.values["end_time_s"] == outcome.trajectory.time[-1]
        assert outcome.trajectory.title == "Swing (interrupted)" and "stopped by request" in outcome.message

    def test_pictures(self) -> None:
        outcome = solve(
            robot="l1_tape", inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3]}, final_time_s=0.05, tolerance=1e-6
        )
        assert list(outcome.figures) == ["signals", "energy"]
        signals, energy = (draw() for draw in outcome.figures.values())
        assert [a.get_ylabel() for a in signals.axes] == ["[m]", "[m/s]", "[N]"]
        legend = [t.get_text() for t in signals.axes[0].get_legend().get_texts()]
        assert legend == [f"{n}[{i}]" for n in "qT" for i in range(3)]
        assert signals.axes[-1].get_xlabel() == "time [s]"
        assert [t.get_text() for t in energy.axes[0].get_legend().get_texts()] == [
            "stored, since the start", "supplied", "dissipated",
        ]  # fmt: skip

    def test_explain(self) -> None:
        problem = validate(simulation.Schema, SWING)
        told = simulation.explain(problem, Context())
        assert told.startswith("Swing: 1 s\nPendulum: simulation by CVODES (bdf), tolerance 1e-11\n  prescribed: tau\n")
        assert "phi = 0.01  prescribed, or follows" in told and "pendulum.py:" in told
        told = simulation.explain(validate(simulation.Schema, {**SWING, "start": {}}), Context())
        assert "der(phi) = 0  chosen by the initialisation" in told


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
            assert list(done.json["values"]) == list(simulation.VALUES)
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

    def test_time_limit_keeps_what_there_is(self, here: Path) -> None:
        loaded = load(self.toml(here), ["final_time_s=100000.0", "step_s=0.5"])
        context = run.context_of(loaded, max_seconds=1.5)
        outcome = run.solve(loaded, context).outcome
        assert outcome.status is SolveStatus.INTERRUPTED and outcome.values["end_time_s"] < 100000.0
        assert outcome.trajectory is not None and len(outcome.trajectory) > 10
