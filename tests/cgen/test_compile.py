"""A generated folder compiles as delivered, in C and C++, alone and beside others, and refuses what breaks it."""

import re
import shutil
from pathlib import Path

import pytest

from gtmodel import cgen
from gtmodel._files import codegen_dir
from tests.cgen.conftest import Functions, c_files, copy, run, succeed

STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
FAITHFUL = "every vector is reproduced bit for bit"


@pytest.mark.parametrize("which", ["l1_folder", "small_folder"])
def test_compiles_as_delivered_and_tests_itself(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    folder = copy(request.getfixturevalue(which), tmp_path)
    succeed("sh", "-c", "cc *.c -lm", cwd=folder)
    assert FAITHFUL in succeed("./a.out", cwd=folder)


def test_makefile_builds_a_library_and_checks(small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    assert FAITHFUL in succeed("make", "check", cwd=folder)
    assert (folder / "libgt_small.a").is_file()
    succeed("make", "clean", cwd=folder)
    assert sorted(p.name for p in folder.iterdir()) == sorted(p.name for p in small_folder.iterdir())


COMPILERS = ("cc -std=c99", "g++ -x c++ -std=c++17", "clang -std=c99", "clang++ -x c++ -std=c++17")


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("which", ["small", "newton"])
def test_all_is_clean_without_an_exception(
    compiler: str, which: str, small_folder: Path, newton_functions: Functions, tmp_path: Path
) -> None:
    words = compiler.split()
    if shutil.which(words[0]) is None:
        pytest.skip(f"there is no {words[0]} on this machine: install the package {words[0].replace('++', '')}")
    if which == "small":
        folder = copy(small_folder, tmp_path)
    else:
        folder = cgen.generate({"fk": newton_functions["six_link_fk"]}, tmp_path / "six", name="six").folder
    done = run(*words, *STRICT, "-c", *c_files(folder), cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_hand_written_c_is_clean_too(small_folder: Path, tmp_path: Path) -> None:
    """Runtime and loop, by clang where there is one: gcc compiles them in every test of the loop."""
    if shutil.which("clang") is None:
        pytest.skip("there is no clang on this machine: install the package clang")
    place = codegen_dir()
    files = [p for name in ("runtime", "loop") for p in sorted((place / name).glob("*.c"))]
    files = [p for p in files if p.name != "gt_model_main.c"]
    include = [f"-I{place / name}" for name in ("runtime", "loop")]
    done = run("clang", "-std=c99", *STRICT, *include, "-c", *files, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_cpp_program_calls_c(small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    program = """
        #include "gt_small.h"
        #include <cmath>
        int main() {
            gt_small_slider_in in{0.0, 1.0};
            gt_small_slider_out out{};
            const gt_status status = gt_small_slider(&in, &out);
            return (status == GT_OK && std::fabs(out.x_m - 0.4) < 1e-15) ? 0 : 1;
        }"""
    (folder / "app.cpp").write_text(program)
    (folder / "gt_small_main.c").unlink()
    succeed("cc", "-std=c99", "-c", *c_files(folder), cwd=folder)
    succeed("sh", "-c", "g++ -std=c++17 app.cpp *.o -lm -o app", cwd=folder)
    assert run("./app", cwd=folder).returncode == 0


def test_example_of_the_readme_runs(small_folder: Path, tmp_path: Path) -> None:
    folder = copy(small_folder, tmp_path)
    (example,) = re.findall(r"```c\n(.*?)```", (folder / "README.md").read_text(), re.S)
    (folder / "app.c").write_text(example)
    succeed("cc", "-std=c99", *STRICT, "-c", "app.c", cwd=folder)
    succeed("sh", "-c", "cc *.c -lm -o app", cwd=folder)  # its own main beside ours
    assert re.fullmatch(r"x_m = 0\.\d+\n", succeed("./app", cwd=folder))


def test_two_folders_link_into_one_program(small: Functions, small_folder: Path, tmp_path: Path) -> None:
    other = cgen.generate(small, tmp_path / "other", name="other").folder
    sources = [small_folder / f for f in c_files(small_folder)] + [other / f for f in c_files(other)]
    app = '#include "gt_small.h"\n#include "gt_other.h"\nint main(void) '
    app += "{ return gt_small_selftest() + gt_other_selftest(); }\n"
    (tmp_path / "app.c").write_text(app)
    command = ["cc", f"-I{small_folder}", f"-I{other}", "app.c", *sources, "-lm", "-o", "app"]
    succeed(*command, cwd=tmp_path)
    assert run("./app", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize("flag", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_flags_that_remove_nan_are_refused(flag: str, small_folder: Path, tmp_path: Path) -> None:
    done = run("cc", flag, "-c", small_folder / "gt_small.c", "-o", "x.o", cwd=tmp_path)
    assert done.returncode != 0 and "tests for NaN" in done.stderr


def test_contraction_is_switched_off_where_the_project_forgets(l1_folder: Path, tmp_path: Path) -> None:
    flags = ("-O3", "-march=native", "-ffp-contract=fast")
    if "__FP_FAST_FMA 1" not in run("cc", *flags, "-dM", "-E", "-x", "c", "/dev/null", cwd=tmp_path).stdout:
        pytest.skip("this processor or compiler has no fused multiply-add")
    succeed("cc", *flags, *[l1_folder / f for f in c_files(l1_folder)], "-lm", cwd=tmp_path)
    assert FAITHFUL in succeed("./a.out", cwd=tmp_path)


def test_no_undefined_behaviour(small_folder: Path, tmp_path: Path) -> None:
    flags = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    built = run("cc", *flags, *[small_folder / f for f in c_files(small_folder)], "-lm", cwd=tmp_path)
    if "cannot find" in built.stderr:
        pytest.skip("this compiler has no sanitizers")
    assert built.returncode == 0, built.stderr
    assert FAITHFUL in succeed("./a.out", cwd=tmp_path)


def test_symbols_are_the_golden_list(small_folder: Path, tmp_path: Path) -> None:
    succeed("cc", "-O2", "-c", *[small_folder / f for f in c_files(small_folder)], cwd=tmp_path)
    listing = succeed("sh", "-c", "nm -g --defined-only *.o", cwd=tmp_path)
    symbols = sorted(
        " ".join(line.split()[1:]) for line in listing.splitlines() if line and line[0] in "0123456789abcdef"
    )
    golden = (Path(__file__).parent / "symbols.txt").read_text().splitlines()
    assert symbols == [line for line in golden if not line.startswith("#")]
