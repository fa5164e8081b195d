"""The library and the archive: symbols, what it links, sizes, bytes, sources, tools that look for memory faults."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gtmodel._files import codegen_dir
from gtmodel.compiler.toolchain import WARNINGS, find
from gtmodel.fmu.export import FLAGS, LINK, WINDOWS, windows_library
from tests.fmu.makers import MAKERS
from tests.fmu.raw import OK, Raw

CLONE = Path(__file__).parents[2]
HEADERS = {3: "fmi3/fmi3Functions.h", 2: "fmi2/fmi2Functions.h"}
COUNT = {3: 75, 2: 44}
L1_BYTES, SIX_LINK_BYTES = 60_000, 150_000


def run(*command, **more):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=600, **more)


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ["forward", "d1_fk", "block"])
def test_all_functions_of_the_header_are_exported_and_no_others(made, name, version):
    _, library, _ = made(name, version)
    header = (codegen_dir() / "fmu" / HEADERS[version]).read_text()
    wanted = set(re.findall(rf"FMI{version}_Export fmi{version}\w+TYPE\s+(fmi{version}\w+);", header))
    lines = run("nm", "-D", "--defined-only", library).stdout.splitlines()
    exported = {line.split()[-1].partition("@")[0] for line in lines}
    assert len(wanted) == COUNT[version]
    assert exported == wanted


@pytest.mark.parametrize("version", [3, 2])
def test_only_libm_and_libc_are_needed(made, version):
    _, library, _ = made("d1_fk", version)
    needed = re.findall(r"NEEDED.*\[(.*?)\]", run("readelf", "-d", library).stdout)
    assert set(needed) <= {"libm.so.6", "libc.so.6"}


# the largest of each robot; version 2 has fewer functions
LARGE = [("forward_p", 3), ("f1_fk", 3)]
SMALL = [(n, v) for v in (3, 2) for n in ("fk", "ik", "inverse", "forward", "forward_p", "d1_fk", "f1_fk", "f1_ik")]
SIZES = [*LARGE, *(pytest.param(*case, marks=pytest.mark.proof) for case in SMALL if case not in LARGE)]


@pytest.mark.parametrize(("name", "version"), SIZES)
def test_sizes(as_delivered, name, version):
    most = SIX_LINK_BYTES if name in ("d1_fk", "f1_fk", "f1_ik") else L1_BYTES
    assert len(MAKERS[name](version).data) <= most


OF_ALL_SORTS = [("forward", 3), ("forward", 2), ("spiral_p", 3), ("block", 3), ("held", 3)]
OTHERS = [("d1_fk", 3), ("d1_fk", 2), ("spiral_p", 2), ("block", 2), ("held", 2)]


@pytest.mark.parametrize(
    ("name", "version"), [*OF_ALL_SORTS, *(pytest.param(*case, marks=pytest.mark.proof) for case in OTHERS)]
)
def test_the_sources_compile_without_a_warning(made, name, version, tmp_path):
    unit, *_ = made(name, version)
    for file, text in unit.sources.items():
        (tmp_path / file).write_text(text)
    tools = find()
    own = [w for w in WARNINGS if w != "-Wconversion"]
    for file in sorted(tmp_path.glob("*.c")):
        flags = own if file.name.startswith("gt_fmu") else WARNINGS
        done = run(tools.cc, *FLAGS, *flags, "-c", file.name, "-o", "one.o", cwd=tmp_path)
        assert done.returncode == 0, done.stderr


SCRIPT = """
import datetime, hashlib, os, pathlib, sys, time
os.umask(0o077)
late = 5 * 365 * 86400  # for whatever asks Python; and files written are as old as 1999
now, local, utc, write = time.time, time.localtime, time.gmtime, pathlib.Path.write_text
time.time = lambda: now() + late
time.time_ns = lambda: int(time.time() * 1e9)
time.localtime = lambda t=None: local(time.time() if t is None else t)
time.gmtime = lambda t=None: utc(time.time() if t is None else t)

class Later(datetime.datetime):
    @classmethod
    def now(cls, tz=None):
        return cls.fromtimestamp(time.time(), tz)

datetime.datetime = Later

def write_text(path, *arguments, **more):
    written = write(path, *arguments, **more)
    os.utime(path, (930_000_000, 930_000_000))
    return written

pathlib.Path.write_text = write_text
from tests.fmu.makers import MAKERS
from tests.shaking import shake_as_inherited
shake_as_inherited()
for word in sys.argv[1:]:
    name, version = word.split(":")
    print(word, hashlib.sha256(MAKERS[name](int(version)).data).hexdigest())
"""


EVERY = [(n, v) for n in ("fk", "forward", "d1_fk", "block", "filter") for v in (3, 2)]


@pytest.mark.parametrize("units", [[("block", 3), ("filter", 2)], pytest.param(EVERY, marks=pytest.mark.proof)])
def test_the_same_bytes_in_another_process_at_another_date_with_another_umask(as_delivered, units):
    """Hash seed and zone differ too; Python's clock is five years late, C's __DATE__ that of 1999, as are the files."""
    more = {"TZ": "Asia/Tokyo", "PYTHONHASHSEED": "2", "SOURCE_DATE_EPOCH": "930000000", "PYTHONPATH": str(CLONE)}
    faked = ["faketime", "2031-05-06"] if shutil.which("faketime") else []
    umask = os.umask(0o022)
    try:
        wanted = {f"{n}:{v}": hashlib.sha256(MAKERS[n](v).data).hexdigest() for n, v in units}
    finally:
        os.umask(umask)
    done = run(*faked, sys.executable, "-c", SCRIPT, *wanted, env={**os.environ, **more}, cwd=CLONE)
    assert done.returncode == 0, done.stderr
    assert dict(line.split() for line in done.stdout.splitlines()) == wanted


def test_no_time_stands_in_the_archive(made):
    """No file in it is younger than a zip can say, and no text holds a year of ours."""
    _, _, path = made("fk", 3)
    with zipfile.ZipFile(path) as z:
        assert {i.date_time for i in z.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert [i.filename for i in z.infolist()] == sorted(z.namelist())
        text = z.read("modelDescription.xml").decode() + z.read("documentation/index.html").decode()
        assert "generationDateAndTime" not in text
        assert str(CLONE) not in text
        assert b"/tmp" not in z.read(next(n for n in z.namelist() if n.endswith(".so")))
        assert {"documentation/licenses/fmi-headers.txt", "documentation/licenses/gtmodel.txt"} <= set(z.namelist())
    assert (CLONE / "LICENSE").read_text() == (codegen_dir() / "fmu" / "LICENSE.txt").read_text()


REBUILT = [("forward", 3), ("forward", 2), ("spiral_p", 3)]
MORE = [("spiral_p", 2), ("d1_fk", 3), ("d1_fk", 2)]


@pytest.mark.parametrize(
    ("name", "version"), [*REBUILT, *(pytest.param(*case, marks=pytest.mark.proof) for case in MORE)]
)
def test_rebuilt_from_its_sources_it_is_the_same(made, name, version, tmp_path):
    """With the flags of a user's unit, all files apart: every bit of a run, though the tests' unit is not optimised."""
    unit, library, path = made(name, version)
    with zipfile.ZipFile(path) as z:
        z.extractall(tmp_path)
    sources = tmp_path / "sources"
    done = run(find().cc, *FLAGS, *sorted(p.name for p in sources.glob("*.c")), "-o", "again.so", *LINK, cwd=sources)
    assert done.returncode == 0, done.stderr
    assert np.array_equal(history(unit, library), history(unit, sources / "again.so"))


@pytest.mark.parametrize("version", [3, pytest.param(2, marks=pytest.mark.proof)])
def test_fmpy_builds_it_from_its_sources(made, version, tmp_path):
    pytest.importorskip("fmpy")
    if shutil.which("cmake") is None:
        pytest.skip("there is no cmake on this machine")
    from fmpy.build import build_platform_binary

    unit, library, path = made("forward", version)
    with zipfile.ZipFile(path) as z:
        z.extractall(tmp_path)
    shutil.rmtree(tmp_path / "binaries")
    build_platform_binary(str(tmp_path))
    again = next((tmp_path / "binaries").rglob("*.so"))
    assert np.array_equal(history(unit, library), history(unit, again))


def history(unit, library) -> np.ndarray:
    raw = Raw(unit, library)
    assert raw.begin() == OK
    inputs = unit.table.of("input")
    rows = []
    for k in range(50):
        raw.set([v.reference for v in inputs], [v.start + 0.002 * max(1.0, abs(v.start)) * np.sin(k) for v in inputs])
        assert raw.step(k * 4e-3, 4e-3)[0] == OK
        rows.append(raw.get([v.reference for v in unit.table.numbers])[1])
    return np.array(rows)


def test_a_cross_compiler_makes_the_library_for_windows(made):
    """Compiled and linked for Windows; it is not run. The functions of the header are what it exports."""
    compiler = shutil.which(WINDOWS)
    if compiler is None:
        pytest.skip(f"there is no {WINDOWS} on this machine (package gcc-mingw-w64-x86-64)")
    for version in (3, 2):
        unit, *_ = made("forward", version)
        data = windows_library(compiler, unit.sources)
        assert data[:2] == b"MZ" and data == windows_library(compiler, unit.sources)
        assert data.count(f"fmi{version}Terminate".encode()) >= 1
        assert b"gt_fmu_compute" not in data


DRIVER = r"""
#include "fmi3Functions.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

int main(void)
{
    fmi3ValueReference all[400];
    double values[400];
    size_t n = REALS;
    int round;
    size_t k;

    for (k = 0; k < n; k++) { all[k] = (fmi3ValueReference)k; }
    for (round = 0; round < 2; round++) {
        bool b[5];
        double t = 0.0;
        fmi3FMUState state = NULL;
        size_t size;
        fmi3Byte *bytes;
        fmi3Instance i = round ? fmi3InstantiateModelExchange("a", TOKEN, "", false, false, NULL, NULL)
                               : fmi3InstantiateCoSimulation("a", TOKEN, "", false, false, false, false, NULL, 0, NULL,
                                                             NULL, NULL);
        if (i == NULL) { return 1; }
        if (fmi3EnterInitializationMode(i, false, 0.0, 0.0, false, 0.0) != fmi3OK) { return 2; }
        if (fmi3ExitInitializationMode(i) != fmi3OK) { return 3; }
        if (fmi3GetFMUState(i, &state) != fmi3OK) { return 4; }
        fmi3SerializedFMUStateSize(i, state, &size);
        bytes = malloc(size);
        fmi3SerializeFMUState(i, state, bytes, size);
        if (round) {
            size_t nx;
            double x[100], dx[100], seed[1] = {1.0}, slope[1];
            fmi3UpdateDiscreteStates(i, &b[0], &b[1], &b[2], &b[3], &b[4], &t);
            fmi3EnterContinuousTimeMode(i);
            fmi3GetNumberOfContinuousStates(i, &nx);
            fmi3GetContinuousStates(i, x, nx);
            fmi3SetContinuousStates(i, x, nx);
            fmi3GetContinuousStateDerivatives(i, dx, nx);
            all[0] = UNKNOWN; all[1] = KNOWN;
            fmi3GetDirectionalDerivative(i, &all[0], 1, &all[1], 1, seed, 1, slope, 1);
            fmi3GetAdjointDerivative(i, &all[0], 1, &all[1], 1, seed, 1, slope, 1);
            all[0] = 0; all[1] = 1;
            fmi3CompletedIntegratorStep(i, true, &b[0], &b[1]);
        } else {
            for (k = 0; k < 20; k++) {
                double last;
                fmi3DoStep(i, 0.004 * (double)k, 0.004, true, &b[0], &b[1], &b[2], &last);
            }
        }
        if (fmi3GetFloat64(i, all, n, values, n) != fmi3OK) { return 5; }
        fmi3SetFMUState(i, state);
        fmi3FreeFMUState(i, &state);
        fmi3DeserializeFMUState(i, bytes, size, &state);
        fmi3SetFMUState(i, state);
        fmi3FreeFMUState(i, &state);
        values[1] = NAN;
        fmi3SetFloat64(i, &all[1], 1, &values[1], 1);
        fmi3Reset(i);
        free(bytes);
        fmi3FreeInstance(i);
    }
    (void)printf("done\n");
    return 0;
}
"""


def driver(unit, place: Path, *flags: str) -> Path:
    for file, text in unit.sources.items():
        (place / file).write_text(text)
    (place / "driver.c").write_text(DRIVER)
    t = unit.table
    defined = [f"-DREALS={len(t.numbers)}", f'-DTOKEN="{unit.token}"', f"-DUNKNOWN={t.computed[0]}",
               f"-DKNOWN={t.of('input')[0].reference}"]  # fmt: skip
    sources = sorted(p.name for p in place.glob("*.c"))
    fixed = ["-std=c99", "-g", "-O1", "-ffp-contract=off"]
    done = run(find().cc, *fixed, *flags, *defined, *sources, "-o", "driver", "-lm", cwd=place)
    assert done.returncode == 0, done.stderr
    return place / "driver"


@pytest.mark.parametrize("name", ["d1_fk", "block", "forward_p", pytest.param("forward", marks=pytest.mark.proof)])
def test_sanitizers_see_nothing(made, name, tmp_path):
    program = driver(made(name, 3)[0], tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    done = run(program, env={**os.environ, "ASAN_OPTIONS": "detect_leaks=1"})
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


@pytest.mark.parametrize(
    "name", ["spiral_p", *(pytest.param(n, marks=pytest.mark.proof) for n in ("forward", "d1_fk"))]
)
def test_valgrind_sees_nothing(made, name, tmp_path):
    if shutil.which("valgrind") is None:
        pytest.skip("there is no valgrind on this machine")
    program = driver(made(name, 3)[0], tmp_path)
    done = run("valgrind", "--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=all", program)
    assert done.returncode == 0, done.stderr
    assert "ERROR SUMMARY: 0 errors" in done.stderr and "All heap blocks were freed" in done.stderr


def test_two_units_in_one_program_share_nothing(made):
    """Bodies of both have the same names inside."""
    first, second = made("fk", 3), made("ik", 3)
    a, b = Raw(*first[:2]), Raw(*second[:2])
    assert a.begin() == b.begin() == OK
    before = a.get(first[0].table.computed)[1]
    b.get(second[0].table.computed)
    assert a.get(first[0].table.computed)[1].tolist() == before.tolist()
    assert MAKERS
