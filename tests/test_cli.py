"""The command line from outside, as a user and a user's script see it."""

import json
import math
import re
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from gtmodel import problem_files as kinds
from gtmodel.cgen import CodeStudy
from gtmodel.cgen.verification import against_python
from gtmodel.kinds.codegen import kind as codegen_kind
from gtmodel.problem_files import from_options
from gtmodel.problem_files.registry import results_of
from gtmodel.results.quantity import described, unit_of
from tests.support.commands import CLONE, Commands, command, environment, process
from tests.support.own_models import FILES

JSON_KEYS = ["problem", "kind", "status", "message", "objective", "iterations", "wall_s", "checks", "values"]
# minimum time of a double integrator over an angle: 2 sqrt(angle * inertia / torque)
SWING_TIME_S = 2 * math.sqrt(1.0 * 1.0 * 0.5**2 / 1.0)
STROKE_TIME_S = 2 * math.sqrt(math.pi / 2 * 0.01 / 1.0)
TIME_TOLERANCE = 1e-5  # the solver's 1e-8 on the scaled conditions leaves some 1e-7 in the final time


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder outside the clone that holds a user's own models and problems."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


# -- list, schema, explain -------------------------------------------------------------------------


def test_list_shows_robots_and_problems(gtmodel: Commands) -> None:
    everything = gtmodel("list")
    assert everything.code == 0 and "l1_tape" in everything.out and "l1_min_time" in everything.out
    robots = gtmodel("list", "robots", "--json").json
    assert list(robots) == ["robots"] and "Dressler 2012" in robots["robots"]["l1_tape"]["source"]
    problems = gtmodel("list", "problems", "--json").json["problems"]
    assert sorted(problems) == sorted(p.stem for p in (CLONE / "problems").glob("*.toml"))
    assert problems["l1_min_time"]["kind"] == "trajectory"


def test_a_pipe_gets_whole_lines(here: Path) -> None:
    lines = process("list", "robots", cwd=here, COLUMNS="20").out.splitlines()
    assert any("l1_tape" in line and "Dressler 2012, Table 5.7 manually measured" in line for line in lines)


@pytest.mark.parametrize("kind", kinds.names())
def test_schema_describes_every_key_and_value(gtmodel: Commands, kind: str) -> None:
    printed = gtmodel("schema", kind)
    document = gtmodel("schema", kind, "--json").json
    assert printed.code == 0 and document["kind"] == kind
    for key in document["keys"]:
        assert key["description"], f"key {key['key']} of kind '{kind}' has no description: add it to its annotation"
        assert key["key"] in printed.out
        assert key["unit"] == unit_of(from_options.Key(**key).name) or not key["unit"], key["key"]
    assert document["values"]
    for name, about in document["values"].items():
        assert about["description"], f"result {name} of kind '{kind}' has no description: add it to its annotation"
        assert name in printed.out
    assert "properties" in document["schema"]


def test_schema_shows_units_and_defaults(gtmodel: Commands) -> None:
    lines = gtmodel("schema", "trajectory").out.splitlines()
    (force,) = [line for line in lines if line.split()[:1] == ["limits.force_N"]]
    assert "[N]" in force and "required" in force
    (elements,) = [line for line in lines if line.split()[:1] == ["mesh.elements"]]
    assert "default 50" in elements


def test_schema_fits_80_columns_in_a_pipe(gtmodel: Commands, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr("sys.__stdout__", None)  # the terminal of whoever runs the tests
    lines = gtmodel("schema", "calibration").out.splitlines()
    assert all(len(line) <= 80 or " " not in line.strip() for line in lines)


def test_the_unit_of_a_value_is_the_declared_one_whatever_its_name_reads_as(gtmodel: Commands) -> None:
    values = {k: gtmodel("schema", k, "--json").json["values"] for k in ("vibration", "dynamic_stiffness")}
    assert values["vibration"]["M_inv_K_1_s2"]["unit"] == "1/s2"  # K is no kelvin
    assert values["dynamic_stiffness"]["damping_N_s_m"]["unit"] == "N.s/m"


def test_schema_without_a_kind_lists_the_kinds(gtmodel: Commands) -> None:
    assert list(gtmodel("schema", "--json").json["kinds"]) == list(kinds.names())


def test_explain_prints_the_certificate_of_a_robot(gtmodel: Commands) -> None:
    words = ("explain", "l1_tape", "--known", "q", "--targets", "T")
    short, full = gtmodel(*words), gtmodel(*words, "--full")
    assert short.code == 0 and "sphere pencil" in short.out and "mechanics/rod.py:" not in short.out
    assert full.code == 0 and "mechanics/rod.py:" in full.out and len(full.out) > 2 * len(short.out)


def test_explain_takes_names_with_commas_and_repeated_options(gtmodel: Commands) -> None:
    first = gtmodel("explain", "pendulum.py:Pendulum", "--known", "tau", "--targets", "phi,der(phi,2)")
    second = gtmodel("explain", "pendulum:Pendulum", "--known", "tau", "--targets", "phi", "--targets", "der(phi, 2)")
    assert first.code == second.code == 0 and first.out == second.out
    assert "phi, der(phi,2) from" in first.out


def test_explain_of_own_slider_crank_names_its_branch(gtmodel: Commands) -> None:
    told = gtmodel("explain", "slider_crank.py:SliderCrank", "--known", "phi", "--targets", "x", "--full")
    assert told.code == 0 and "branch 'ahead'" in told.out and "slider_crank.py:20" in told.out


@pytest.mark.parametrize("problem", ["swing.toml", "pendulum_code.toml", "problems/l1_min_time.toml"])
def test_explain_tells_about_a_problem(gtmodel: Commands, problem: str) -> None:
    told = gtmodel("explain", problem)
    assert told.code == 0 and len(told.out.splitlines()) > 3


# -- solve -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("problem", "time_s"), [("swing.toml", SWING_TIME_S), ("stroke.toml", STROKE_TIME_S)])
def test_own_optimization_is_solved(gtmodel: Commands, problem: str, time_s: float) -> None:
    done = gtmodel("solve", problem, "--json")
    assert done.code == 0 and done.err == ""
    assert list(done.json) == JSON_KEYS
    assert done.json["problem"] == problem and done.json["status"] == "solved"
    assert done.json["values"]["final_time_s"] == pytest.approx(time_s, rel=TIME_TOLERANCE)
    assert all(check["passed"] and set(check) == {"value", "bound", "passed"} for check in done.json["checks"].values())
    assert list(done.json["values"]) == list(described(*results_of("optimization")))


def test_people_read_one_table(gtmodel: Commands) -> None:
    done = gtmodel("solve", "swing.toml")
    assert done.code == 0 and done.err == ""
    rows = [re.split(r"\s{2,}", line.strip()) for line in done.out.splitlines()]
    assert rows[0] == ["Swing of a pendulum"]
    assert ["final time", "1", "s"] in rows
    assert any(row[0] == "constraint violation" and "passed" in row[-1] for row in rows)


def test_set_changes_any_key(gtmodel: Commands) -> None:
    quarter = gtmodel("solve", "swing.toml", "--json", "--set", "parameters.angle=0.25", "--set", "mesh.points=2")
    assert quarter.json["values"]["final_time_s"] == pytest.approx(SWING_TIME_S / 2, rel=TIME_TOLERANCE)


def test_result_is_the_same_in_two_processes(here: Path) -> None:
    texts = []
    for seed in ("1", "2"):
        done = process("solve", "swing.toml", "--json", "--out", f"run{seed}", cwd=here, PYTHONHASHSEED=seed)
        assert done.code == 0
        texts.append([(here / f"run{seed}" / name).read_bytes() for name in ("result.json", "trajectory.csv")])
    assert texts[0] == texts[1]
    assert "wall_s" not in json.loads(texts[0][0])


def test_json_is_alone_on_stdout_whatever_a_model_prints(here: Path) -> None:
    noise = "\nprint('imported')\nimport os\nos.write(1, b'raw')\nos.system('echo shell')\n"
    (here / "pendulum.py").write_text(noise + FILES["pendulum.py"], encoding="utf-8")
    done = process("solve", "swing.toml", "--json", cwd=here)
    assert done.json["status"] == "solved" and len(done.out.splitlines()) == 1
    assert "imported" in done.err and "raw" in done.err and "shell" in done.err


@pytest.fixture(scope="module")
def prototype(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the shipped problem was solved on a coarse mesh, from outside the clone."""
    cwd = tmp_path_factory.mktemp("prototype")
    done = process("solve", "problems/l1_min_time.toml", "--set", "mesh.elements=50", "--json", "--plot", cwd=cwd)
    assert done.code == 0, done.err
    (cwd / "stdout.json").write_text(done.out)
    (cwd / "stderr.txt").write_text(done.err)
    return cwd


def test_shipped_problem_is_found_outside_the_clone(prototype: Path) -> None:
    assert "shipped with gtmodel" in (prototype / "stderr.txt").read_text()


def test_trajectory_announces_its_values(prototype: Path) -> None:
    printed = json.loads((prototype / "stdout.json").read_text())
    assert list(printed) == JSON_KEYS
    assert list(printed["values"]) == list(described(*results_of("trajectory")))
    assert printed["values"]["final_time_s"] > 0


def test_plot_without_out_names_its_own_folder(prototype: Path) -> None:
    folder = prototype / "l1_min_time-result"
    assert {p.name for p in folder.iterdir()} >= {"result.json", "trajectory.csv", "run.toml"}
    assert [p.read_bytes()[:8] for p in folder.glob("*.png")] == [b"\x89PNG\r\n\x1a\n"]
    run = tomllib.loads((folder / "run.toml").read_text())
    assert run["input"]["set"] == ["mesh.elements=50"] and run["problem"]["mesh"]["elements"] == 50
    assert set(run["files"]) == {p.name for p in folder.iterdir()} - {"run.toml"}
    assert run["wall_s"] > 0 and run["versions"]["casadi"]


# -- stopping and starting again -------------------------------------------------------------------


def test_time_limit_keeps_the_iterate_and_a_solve_starts_from_it(gtmodel: Commands, here: Path) -> None:
    stopped = gtmodel("solve", "swing.toml", "--max-seconds", "1e-6", "--out", "first", "--json")
    assert stopped.code == 1 and stopped.json["status"] == "interrupted"
    assert json.loads((here / "first" / "result.json").read_text())["status"] == "interrupted"
    resumed = gtmodel("solve", "swing.toml", "--start", "first/result.json", "--out", "second", "--json")
    assert resumed.code == 0
    again = gtmodel("solve", "swing.toml", "--start", "second", "--json")
    assert again.json["values"]["final_time_s"] == pytest.approx(SWING_TIME_S, rel=TIME_TOLERANCE)


@pytest.fixture(params=["SIGINT", "SIGTERM", "SIGHUP"])
def interrupted(here: Path, request: pytest.FixtureRequest) -> Iterator[subprocess.Popen[str]]:
    """A solve that was sent Ctrl-C, or another wish that it may end, just before its first iteration."""
    patient = "import sys\nfrom gtmodel import _terminal\n_terminal.GRACE_S = 60.0\n"  # on a busy machine too
    ready = patient + "print('ready', file=sys.stderr, flush=True)\nsys.stdin.readline()\n"
    (here / "pendulum.py").write_text(ready + FILES["pendulum.py"], encoding="utf-8")
    words = command("solve", "swing.toml", "--json", "--out", "stopped")
    pipe = subprocess.PIPE
    with subprocess.Popen(
        words, cwd=here, env=environment(), stdin=pipe, stdout=pipe, stderr=pipe, text=True,
        # tests under nohup ignore SIGHUP, which a command would inherit and rightly go on ignoring
        preexec_fn=lambda: signal.signal(getattr(signal, request.param), signal.SIG_DFL),
    ) as run:  # fmt: skip
        assert run.stderr is not None
        assert run.stderr.readline() == "ready\n"
        run.send_signal(getattr(signal, request.param))
        yield run


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals to another process on Windows")
def test_ctrl_c_and_sigterm_keep_the_best_iterate(interrupted: subprocess.Popen[str], here: Path) -> None:
    out, err = interrupted.communicate("go\n", timeout=60)
    assert interrupted.returncode == 1, err
    assert json.loads(out)["status"] == "interrupted"
    assert (here / "stopped" / "trajectory.csv").is_file()
    assert "Traceback" not in err


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGTERM with a handler on Windows")
@pytest.mark.parametrize(("place", "step"), [(codegen_kind, "compile_causal"), (against_python, "check")])
def test_codegen_stops_between_its_steps(
    gtmodel: Commands, here: Path, monkeypatch: pytest.MonkeyPatch, place: ModuleType, step: str
) -> None:
    """What was not done is not said to be: SIGTERM while a function is derived, and while the code is compared."""
    work = getattr(place, step)

    def stopped(*words: Any, **more: Any) -> Any:
        signal.raise_signal(signal.SIGTERM)
        return work(*words, **more)

    monkeypatch.setattr(place, step, stopped)
    done = gtmodel("codegen", "pendulum_code.toml", "-o", "code", "--costs", "--json", "--set", "check.points=5")
    assert done.code == 1 and done.json["status"] == "interrupted"
    assert not (here / "code" / "manifest.json").exists()


# -- codegen ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("problem", ["pendulum_code.toml", "slider_code.toml"])
def test_codegen_checks_own_models(gtmodel: Commands, here: Path, problem: str) -> None:
    done = gtmodel("codegen", problem, "-o", "code", "--costs", "--json", "--set", "check.points=50")
    assert done.code == 0, done.err
    assert list(done.json) == JSON_KEYS
    assert done.json["checks"] and all(check["passed"] for check in done.json["checks"].values())
    table = gtmodel("codegen", problem, "-o", "again", "--check", "--set", "check.points=50").out
    assert f"checks passed {len(done.json['checks'])}" in " ".join(table.split()) and "at most 0" not in table
    values = done.json["values"]
    assert sorted(values["files"]) == sorted(p.name for p in (here / "code").iterdir())
    assert list(values) == list(described(CodeStudy))


def test_code_that_fails_its_check_is_not_written(
    gtmodel: Commands, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A constant of the C code differs from that of the model."""
    compare = against_python.check

    def spoilt(folder: Path, functions: Any, **settings: Any) -> Any:
        body = folder / "gt_pendulum_body.c"
        text = body.read_text()
        assert "4.905" in text  # m g l
        body.write_text(text.replace("4.905", "4.906"))
        return compare(folder, functions, **settings)

    monkeypatch.setattr(against_python, "check", spoilt)
    words = ("codegen", "pendulum_code.toml", "-o", "code", "--check", "--set", "check.points=50")
    done = gtmodel(*words, "--json")
    assert done.code == 1 and done.json["status"] == "check_failed"
    assert not (here / "code" / "manifest.json").exists()
    assert gtmodel(*words, "--write-failed").code == 1
    sources = [p for p in (here / "code").iterdir() if p.suffix in (".c", ".h")]
    assert sources and all("NOT TO BE USED" in p.read_text().splitlines()[0] for p in sources)
    subprocess.run(["make", "-s"], cwd=here / "code", check=True)  # a mark is a comment


def test_codegen_without_check_compiles_nothing(gtmodel: Commands) -> None:
    done = gtmodel("codegen", "pendulum_code.toml", "-o", "code", "--json")
    assert done.code == 0 and done.json["checks"] == {}
    assert list(done.json["values"]["functions"]) == ["gt_pendulum_inverse_dynamics"]


# -- exit codes and sentences ----------------------------------------------------------------------

REFUSED = [
    (["solve", "nowhere.toml"], "nowhere.toml: there is no such file"),
    (["list", "kinds"], "gtmodel schema"),
    (["solve", "l1_min_tim"], "did you mean the shipped 'l1_min_time'?"),
    (["solve", "swing.toml", "--set", "mesh.elemnts=3"], "swing.toml: mesh.elemnts: unknown key; did you mean 'elem"),
    (
        ["solve", "l1_min_time", "--set", "limits.force_kN=1"],
        "force_kN: unknown key; did you mean 'force_N' (N)?",
    ),
    (["solve", "l1_min_time", "--set", "limits.force_N=-1"], "limits.force_N: must be greater than 0 N; found -1"),
    (
        ["solve", "l1_min_time", "--set", "goal.tcp_m=[9.0, 9.0, 9.0]"],
        "goal.tcp_m: the pose (9, 9, 9) m is out of reach",
    ),
    (["solve", "l1_min_time", "--set", "robot=l1_tap"], "robot: there is no robot 'l1_tap'; did you mean 'l1_tape'?"),
    (["solve", "swing.toml", "--set", "nonsense"], "--set nonsense: expected key=value"),
    (["solve", "swing.toml", "--max-seconds", "-1"], "--max-seconds -1: expected a positive time in s"),
    (["solve", "swing.toml", "--start", "nowhere"], "--start nowhere: there is no such file"),
    (["solve", "swing.toml", "--start", "pendulum.py"], "--start pendulum.py is not a result.json"),
    (["solve", "swing.toml", "--out", "."], "--out . contains files that gtmodel did not write"),
    (["solve", "swing.toml", "--set", "model=pendulum.py:SwingDown"], "has no 'SwingDown'; did you mean 'SwingUp'?"),
    (
        ["solve", "swing.toml", "--set", "model=pendulum.py:Pendulum"],
        "'pendulum.py:Pendulum' is not a subclass of Optimization",
    ),
    (["solve", "swing.toml", "--set", "model=pendulum.py"], "names no class; write 'package.module:Class'"),
    (["solve", "swing.toml", "--set", "model=nowhere.py:A"], "there is no Python file 'nowhere.py'"),
    (["solve", "swing.toml", "--set", "model=nowhere:A"], "there is no Python module 'nowhere'"),
    (
        ["solve", "swing.toml", "--set", "parameters.angel=1"],
        "no declaration 'angel'; did you mean 'angle'?",
    ),
    (["solve", "pendulum_code.toml"], "use gtmodel codegen"),
    (["codegen", "swing.toml", "-o", "code"], "swing.toml: kind: is 'optimization', which generates no code"),
    (["codegen", "pendulum_code.toml", "-o", "."], "is not empty and was not written by gtmodel"),
    (["explain", "l1_tap"], "there is no robot 'l1_tap'; did you mean 'l1_tape'?"),
    (["explain", "l1_tape", "--known", "q"], "name its --targets; top-level names are q, T, tau"),
    (["explain", "pendulum.py:Pendulum", "--targets", "phi"], "pendulum.py:Pendulum: 1 equation for 2 unknowns"),
    (["explain", "l1_tape", "--known", "q", "--targets", "taw"], "has no variable 'taw'; did you mean 'tau'"),
    (["explain", "swing.toml", "--targets", "phi"], "leave --known, --targets and --prefer out"),
    (["schema", "trajectry"], "there is no kind 'trajectry'; did you mean 'trajectory'?"),
    (["list", "robot"], "did you mean 'robots'?"),
    (["solve", "swing.toml", "--nonsense"], "gtmodel solve: No such option: --nonsense"),
    (["solve"], "gtmodel solve: Missing argument"),
    (["dance"], "gtmodel dance: No such command 'dance'"),
]


@pytest.mark.parametrize(("words", "sentence"), REFUSED, ids=[" ".join(words) for words, _ in REFUSED])
def test_bad_input_is_one_sentence_and_exit_code_2(gtmodel: Commands, words: list[str], sentence: str) -> None:
    done = gtmodel(*words)
    assert done.code == 2 and done.out == ""
    said = [line for line in done.err.splitlines() if "using the one shipped with gtmodel" not in line]
    assert len(said) == 1 and sentence in said[0], done.err


@pytest.mark.parametrize("mistyped", ["swin.toml", "swin"])
def test_a_mistyped_file_is_suggested_as_a_path_that_works(gtmodel: Commands, here: Path, mistyped: str) -> None:
    for folder in (Path(), Path("own"), here):
        (here / folder).mkdir(exist_ok=True)
        (here / folder / "swing.toml").write_bytes((here / "swing.toml").read_bytes())
        meant = re.search(r"did you mean '(.*)'\?", gtmodel("solve", str(folder / mistyped)).err)
        assert meant and meant[1] == str(folder / "swing.toml") and (here / meant[1]).is_file()


@pytest.mark.parametrize("words", [["solve", "nowhere.toml"], ["solve", "swing.toml", "--nonsense"]])
def test_bad_input_gives_json_too(gtmodel: Commands, words: list[str]) -> None:
    done = gtmodel(*words, "--json")
    assert done.code == 2 and list(done.json) == JSON_KEYS
    assert done.json["status"] == "bad_input" and done.json["message"].rstrip(".") in done.sentence


def test_no_command_shows_the_help(gtmodel: Commands) -> None:
    done = gtmodel()
    assert done.code == 2 and all(name in done.out for name in ("list", "explain", "schema", "solve", "codegen"))


def test_version(here: Path) -> None:
    assert re.fullmatch(r"gtmodel \d+\.\d+\.\d+\S*\n", process("--version", cwd=here).out)


def test_it_starts_without_what_few_commands_need(here: Path) -> None:
    asked = [sys.executable, "-c", "import sys, gtmodel.cli; print(*sys.modules)"]
    loaded = subprocess.run(asked, cwd=here, env=environment(), capture_output=True, text=True, check=True, timeout=120)
    assert not {"scipy.stats", "scipy.signal", "matplotlib", "control"} & set(loaded.stdout.split())


def test_unsolved_problem_is_exit_code_1_with_json(gtmodel: Commands) -> None:
    done = gtmodel("solve", "swing.toml", "--set", "solver.max_iterations=2", "--json")
    assert done.code == 1 and done.json["status"] == "iteration_limit"
    assert done.sentence.startswith("swing.toml: ")


def test_fault_in_a_persons_model_names_its_line(gtmodel: Commands, here: Path) -> None:
    (here / "wrong.py").write_text(FILES["pendulum.py"].replace("self.angle", "angel"), encoding="utf-8")
    done = gtmodel("solve", "swing.toml", "--set", "model=wrong.py:SwingUp")
    assert done.code == 2 and "NameError: name 'angel' is not defined" in done.sentence
    assert re.search(r"wrong\.py:\d+\)", done.sentence)


def test_internal_error_is_one_sentence_and_exit_code_1(gtmodel: Commands, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gtmodel.optimize.study.solve", None)
    done = gtmodel("solve", "swing.toml", "--json")
    assert done.code == 1 and done.json["status"] == "failed"
    assert "internal error: TypeError" in done.sentence and "--debug" in done.sentence
    assert "Traceback" in gtmodel("--debug", "solve", "swing.toml").err
