"""What a command imports before it starts: nothing that it does not need. Times are in tests/bench."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys

import pytest

import gtmodel as gt
from gtmodel import calibrate, optimize
from gtmodel.problem_files import names

HEAVY = {"numpy", "casadi", "scipy", "matplotlib", "rich"}
RUN = """
import json, os, sys
from gtmodel.cli import main
shown, sys.stdout = sys.stdout, open(os.devnull, "w")
try:
    main({words})
except SystemExit:
    pass
print(json.dumps(sorted(sys.modules)), file=shown)
"""


def imported(program: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


WITHOUT_RESULT = [["--help"], ["--version"], ["solve", "--help"], ["list"], ["list", "robots", "--json"]]


@pytest.mark.parametrize("words", WITHOUT_RESULT)
def test_a_command_that_computes_nothing_imports_nothing_heavy(words: list[str]) -> None:
    modules = imported(RUN.format(words=words))
    assert "gtmodel.cli" in modules and not modules & HEAVY
    assert not {m for m in modules if m.startswith(("gtmodel.compiler", "gtmodel.mechanics", "gtmodel.kinds"))}


def test_the_doctor_imports_nothing_that_may_be_broken() -> None:
    modules = imported(RUN.format(words=["doctor", "--json"]))
    assert "gtmodel._doctor.report" in modules and not modules & (HEAVY | {"control"})


def test_help_of_the_command_line_reads_five_files_of_ours() -> None:
    ours = {m for m in imported(RUN.format(words=["--help"])) if m.startswith("gtmodel")}
    assert ours == {
        "gtmodel",
        "gtmodel._answer",
        "gtmodel._lazy",
        "gtmodel._terminal",
        "gtmodel._version",
        "gtmodel.cli",
    }


SCHEMAS = """
import json, os, sys
from gtmodel.cli import main
shown, sys.stdout = sys.stdout, open(os.devnull, "w")
known, importers = dict(), dict()
class Watch:
    def find_spec(name, path=None, target=None):
        frame = sys._getframe(1)
        while frame and ("importlib" in frame.f_code.co_filename or "_lazy" in frame.f_code.co_filename):
            frame = frame.f_back
        importers.setdefault(name, f"{{frame.f_code.co_filename}}:{{frame.f_lineno}}")
sys.meta_path.insert(0, Watch)
for kind in {kinds}:
    try:
        main(["schema", kind])
    except SystemExit:
        pass
    known[kind] = {{name: importers.get(name, "") for name in sys.modules}}
print(json.dumps(known), file=shown)
"""


@pytest.fixture(scope="module")
def imported_by_schemas() -> dict[str, dict[str, str]]:
    """By kind the modules that its schema imports and no kind before it, each with the line that imports it."""
    words = [sys.executable, "-c", SCHEMAS.format(kinds=list(names()))]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    seen: set[str] = set()
    first: dict[str, dict[str, str]] = {}
    for kind, modules in json.loads(done.stdout).items():
        first[kind] = {name: place for name, place in modules.items() if name not in seen}
        seen |= set(modules)
    return first


ENGINES = {"gtmodel.compiler", "gtmodel.optimize.solve", "gtmodel.vibration.impulse", "gtmodel.motion.motion_study"}
NOT_FOR_A_SCHEMA = (
    (HEAVY - {"numpy"}) | ENGINES | {"gtmodel.lang.model", "gtmodel.results.written", "gtmodel.robots.f1"}
)


@pytest.mark.parametrize("kind", names())
def test_a_schema_needs_no_model_no_engine_and_writes_no_study(
    kind: str, imported_by_schemas: dict[str, dict[str, str]]
) -> None:
    assert any(f"gtmodel.kinds.{kind}" in modules for modules in imported_by_schemas.values())
    modules = imported_by_schemas[kind]
    wrong = [f"{place} imports {name}" for name, place in modules.items() if name in NOT_FOR_A_SCHEMA]
    assert not wrong, f"the schema of kind '{kind}' must not import an engine: {'; '.join(wrong)}"


def test_a_solve_without_pictures_imports_no_matplotlib_and_no_other_family_of_robots() -> None:
    modules = imported(RUN.format(words=["solve", "l1_min_time", "--quiet", "--max-seconds", "0.01"]))
    assert "gtmodel.robots.three_link" in modules and "gtmodel.compiler.plan" in modules
    assert not modules & {"matplotlib", "rich", "gtmodel.robots.f1", "gtmodel.robots.six_link", "gtmodel.robots.kuka"}
    assert not modules & {"scipy", "numpy.ma"}  # would take as long as all other packages
    assert not {m for m in modules if m.startswith(("gtmodel.plot", "gtmodel.problem_files.robot_file"))}


def test_a_solve_asks_no_installed_package_for_plugins() -> None:
    """pydantic would ask all of them, through a function that fails here."""
    words = ["solve", "l1_min_time", "--quiet", "--max-seconds", "0.01"]
    program = "import importlib.metadata; importlib.metadata.entry_points = None\n" + RUN.format(words=words)
    assert "gtmodel.robots.three_link" in imported(program)


def test_versions_of_packages_are_known_without_reading_what_they_say_of_themselves() -> None:
    program = "import json, sys; from gtmodel.results.written import versions; versions(); "
    modules = imported(program + "print(json.dumps(list(sys.modules)))")
    assert "gtmodel.results.written" in modules and not modules & {"importlib.metadata", "subprocess", "scipy"}


SEARCHES = """
import atexit, gc, json, os, sys
from gtmodel.__main__ import run
sys.argv = ["gtmodel", *{words}]
shown, sys.stdout = sys.stdout, open(os.devnull, "w")
searches = []
gc.callbacks.append(lambda phase, about: searches.append(about["generation"]) if phase == "stop" else None)
atexit.register(lambda: print(json.dumps([len(searches), gc.get_freeze_count() > 0]), file=shown, flush=True))
run()
"""


@pytest.mark.parametrize("words", [["list"], ["schema", "calibration"]])
def test_a_command_that_computes_nothing_searches_for_no_garbage(words: list[str]) -> None:
    program = SEARCHES.format(words=words)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    searches, left_to_the_end = json.loads(done.stdout)
    assert searches <= 1 and left_to_the_end


def test_the_package_alone_imports_nothing_until_a_name_is_used() -> None:
    modules = imported("import json, sys, gtmodel; print(json.dumps(sorted(sys.modules)))")
    assert not modules & HEAVY and {m for m in modules if m.startswith("gtmodel.")} == {
        "gtmodel._lazy",
        "gtmodel._version",
    }


def test_a_function_is_not_hidden_by_the_module_of_its_name() -> None:
    import gtmodel.calibrate.pose_selection
    import gtmodel.optimize.estimate
    import gtmodel.optimize.solve  # noqa: F401

    assert callable(optimize.solve) and callable(optimize.estimate) and callable(calibrate.candidates)
    assert optimize.solve is gt.solve and optimize.estimate is gt.estimate


MODULES = ["calibrate.plan.PlanSimulation", "kinematics.section", "lang.units", "loop.egm", "motion.elastic"]


@pytest.mark.parametrize("name", MODULES)
def test_a_module_of_a_package_is_there_when_it_is_used(name: str) -> None:
    code = f"import gtmodel as gt, json; gt.{name}; assert not hasattr(gt, 'lang.units'); print(json.dumps([]))"
    assert imported(code) == set()


def test_an_error_about_a_name_goes_between_processes() -> None:
    with pytest.raises(AttributeError) as caught:
        calibrate.stdy  # noqa: B018
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_a_misspelt_name_is_answered_with_near_ones() -> None:
    with pytest.raises(AttributeError, match=r"'gtmodel\.calibrate' has no attribute 'stdy'; did you mean 'study'"):
        calibrate.stdy  # noqa: B018
    with pytest.raises(AttributeError, match=r"did you mean 'natural_modes'\?$"):
        gt.modes  # noqa: B018
    with pytest.raises(AttributeError, match=r"did you mean 'AxisMesh' or 'MotionMesh'\?$"):
        gt.motion.Mesh  # noqa: B018
    assert not hasattr(gt, "no_such_thing") and getattr(gt, "no_such_thing", 1) == 1


def test_numpy_on_the_left_of_an_expression_needs_no_function_of_gt_before() -> None:
    """Ground has np.eye(3) == R: a first model in a fresh process failed where no function had been used."""
    script = (
        "import gtmodel as gt; b = gt.Builder('b'); g = b.part('g', gt.mechanics.Ground()); "
        "load = b.part('load', gt.mechanics.FrameLoad()); b.add(gt.connect(g.frame, load.frame)); "
        "b.causal(known=['load.force', 'load.torque'], targets='g.frame.r'); print('made')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.stdout == "made\n", done.stderr
