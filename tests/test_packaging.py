"""An installed gtmodel solves and generates outside the clone: what the wheel holds, and that it runs."""

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

CLONE = Path(__file__).resolve().parents[1]
NOT_TO_SHIP = {"emps", "abb_imu"}  # folders of recordings that may lie there but not be shipped


def run(*command: str | Path, cwd: Path) -> str:
    """Standard output of a command that must succeed and must not see the clone through PYTHONPATH."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [str(c) for c in command], cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def build(kind: str, source: Path, target: Path) -> Path:
    run(sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", target, cwd=source)
    (built,) = target.iterdir()
    return built


def shipped_files(folder: str) -> set[str]:
    """Paths below a folder of the clone, but for what interpreters and compilers leave there."""
    leftovers = {".pyc", ".o", ".a", ".so"}
    return {
        p.relative_to(CLONE).as_posix()
        for p in (CLONE / folder).rglob("*")
        if p.is_file() and p.suffix not in leftovers and not NOT_TO_SHIP & set(p.parts)
    }


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", CLONE, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of a fresh environment: gtmodel from the wheel, dependencies from the running one."""
    home = tmp_path_factory.mktemp("installed") / "venv"
    venv.create(home, symlinks=True)
    (site,) = home.glob("lib/python*/site-packages")
    # A folder named in a .pth file goes on the path, but the .pth files in it are not read:
    # the editable install, which is one of those, stays out.
    folders = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    (site / "dependencies.pth").write_text("\n".join(sorted(folders)) + "\n")
    python = home / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install",
        "--quiet", "--no-compile", "--no-deps", "--no-index", "--ignore-installed", wheel, cwd=home)  # fmt: skip
    return home / "bin"


def test_wheel_holds_problems_c_sources_and_data(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    problems, sources = shipped_files("problems"), shipped_files("codegen")
    assert any(p.endswith(".toml") for p in problems)
    assert any(p.endswith(".c") for p in sources)
    data = {p for p in shipped_files("gtmodel") if p.endswith((".toml", ".json"))}
    assert any(p.endswith(".toml") for p in data), "the robots' printed tables are TOML files inside the package"
    assert any(p.endswith("start_systems.json") for p in data), "the assembly modes start from stored solutions"
    expected = {f"gtmodel/_data/{p}" for p in problems | sources} | data | {"gtmodel/py.typed"}
    assert sorted(expected - names) == []


def test_wheel_holds_nothing_else(wheel: Path) -> None:
    roots = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {root.split("-")[0] for root in roots} == {"gtmodel"}


def test_source_archive_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    archive = build("sdist", CLONE, tmp_path / "sdist")
    run(sys.executable, "-m", "tarfile", "-e", archive, tmp_path, cwd=tmp_path)
    (unpacked,) = tmp_path.glob("gtmodel-*/")
    again = build("wheel", unpacked, tmp_path / "wheel")
    assert zipfile.ZipFile(again).namelist() == zipfile.ZipFile(wheel).namelist()


def test_installed_package_is_not_the_clone(installed: Path, tmp_path: Path) -> None:
    question = "import gtmodel._files as f; print(f.__file__, f.problems_dir(), f.codegen_dir(), sep='\\n')"
    places = run(installed / "python", "-c", question, cwd=tmp_path).split()
    for place in map(Path, places):
        assert place.is_relative_to(installed.parent) and place.exists()


def test_clone_reads_its_own_folders() -> None:
    from gtmodel._files import codegen_dir, problems_dir

    assert (problems_dir(), codegen_dir()) == (CLONE / "problems", CLONE / "codegen")


def test_installed_command_lists(installed: Path, tmp_path: Path) -> None:
    problems = run(installed / "gtmodel", "list", "problems", "--json", cwd=tmp_path)
    assert isinstance(json.loads(problems), dict)
    for problem in (CLONE / "problems").glob("*.toml"):
        assert problem.stem in problems
    explained = run(installed / "gtmodel", "explain", "judge_hexapod", cwd=tmp_path)  # reads its recording
    assert "54 poses" in explained
    robots = run(installed / "gtmodel", "list", "robots", "--json", cwd=tmp_path)
    assert "l1_tape" in robots and isinstance(json.loads(robots), dict)


def test_installed_package_finds_assembly_modes(installed: Path, tmp_path: Path) -> None:
    program = """
import numpy as np
from gtmodel.kinematics.assembly_modes import assembly_modes
random = np.random.default_rng(1)
print(assembly_modes(random.normal(size=(6, 3)), random.normal(size=(6, 3)), np.full(6, 2.0)).status)
"""
    assert run(installed / "python", "-c", program, cwd=tmp_path).strip() == "complete"


@pytest.mark.slow
def test_installed_command_solves_and_generates(installed: Path, tmp_path: Path) -> None:
    problems = next(installed.parent.glob("lib/python*/site-packages/gtmodel/_data/problems"))
    gtmodel = installed / "gtmodel"
    solved = run(gtmodel, "solve", problems / "l1_min_time.toml", "--set", "mesh.elements=10",
                 "--json", "--out", tmp_path / "motion", cwd=tmp_path)  # fmt: skip
    assert json.loads(solved)["values"]["final_time_s"] > 0
    assert (tmp_path / "motion" / "result.json").is_file()
    generated = run(gtmodel, "codegen", problems / "l1_controller.toml", "-o", tmp_path / "l1",
                    "--check", "--json", cwd=tmp_path)  # fmt: skip
    assert isinstance(json.loads(generated), dict)
    assert list((tmp_path / "l1").rglob("*.c"))
