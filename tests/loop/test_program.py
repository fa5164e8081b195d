"""The program and its sources: strict in C and in C++, nothing allocated, no state of its own, refusals."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gtmodel import Status
from gtmodel._files import codegen_dir
from gtmodel.cgen import GenerationError, generate
from gtmodel.compiler.causal import CausalFunction
from gtmodel.loop import LoopError, LoopProcess, build
from gtmodel.loop.build import PROGRAM, adapter, built_before, manifest_of
from tests.loop.bench import Bench, text
from tests.loop.conftest import STRICT

PLACES = (codegen_dir() / "runtime", codegen_dir() / "loop")
SOURCES = [p for place in PLACES for p in sorted(place.glob("*.c")) if p.name != "gt_model_main.c"]
# what the pure parts may ask for besides each other; the rest of the loop is POSIX
PURE = {"floor", "sqrt", "memcpy", "memset", "memcmp", "strcmp"}
POSIX = {
    f"gt_{name}.c"
    for name in ("arguments", "log_writer", "loop_main", "realtime", "report", "run_law", "socket", "table")
}
INCLUDE = [f"-I{place}" for place in PLACES]
CALLS = r"""
#include "gt_laws.h"
#include <stdio.h>

static const double q[3] = {-1.04, -1.14, -1.09}, v[3] = {0.1, 0.2, 0.3}, a[3] = {1.0, 2.0, 3.0}, far[3] = {0.0, 1e300};

static void show(gt_status status, const double *x)
{
    printf("%d %.17g %.17g %.17g\n", (int)status, x[0], x[1], x[2]);
}

int main(void)
{
    double tcp[3], force[3] = {7.0, 7.0, 7.0}, held[3] = {7.0, 7.0, 7.0};
    show(gt_loop_model.forward(q, tcp), tcp);
    show(gt_loop_model.inverse_dynamics(tcp, v, a, force), force);
    show(gt_loop_model.inverse_dynamics(tcp, v, far, held), held);
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("c++") is None, reason="there is no C++ compiler on this machine")
def test_all_sources_are_also_cpp() -> None:
    command = ["c++", "-x", "c++", "-std=c++17", *STRICT, *INCLUDE, "-fsyntax-only", *map(str, SOURCES)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_objects_hold_no_state_and_ask_for_nothing(tmp_path: Path) -> None:
    pure = [p for p in SOURCES if p.name not in POSIX]
    flags = ["-std=c99", *STRICT, *INCLUDE, "-fno-stack-protector", "-U_FORTIFY_SOURCE"]
    flags += ["-fno-pic", "-fno-pie", "-O1", "-c"]  # -fPIC would put tables of pointers among the variables
    done = subprocess.run(["cc", *flags, *map(str, pure)], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    objects = sorted(map(str, tmp_path.glob("*.o")))
    listing = subprocess.run(["nm", *objects], capture_output=True, text=True, check=True).stdout
    rows = [line.split() for line in listing.splitlines() if line and not line.endswith(":")]
    assert [row[-1] for row in rows if row[-2] in "bBdDC"] == [], "no variable that changes"
    defined = {row[-1] for row in rows if row[-2] in "TRr"}
    wanted = {row[-1] for row in rows if row[-2] == "U"}
    assert wanted - defined - PURE == {"gt_loop_model"}, "the adapter's"


def test_files_are_small_and_begin_with_their_purpose() -> None:
    for path in (p for place in PLACES for p in place.iterdir()):
        content = path.read_text()
        assert len(content.splitlines()) < 250, path.name
        assert content.startswith("/* "), path.name
        assert "malloc" not in content


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--bind", "0.0.0.0"], "a peer beyond loopback needs --lowest, --highest, --step and --beyond-loopback"),
        (["--allow", "192.168.125.1", "--beyond-loopback"], "a peer beyond loopback needs"),
        (["--bind", "127.0.0.1.", "--step", "1"], "a peer beyond loopback needs"),
        (["--law", "guess"], "--law: expected trajectory, dynamics, replay"),
        (["--reference", "/nowhere"], "--reference: there is no such table: /nowhere"),
        (["--peer", "abb"], "--peer: expected egm or rsi"),
        (["--hold", "-1"], "--hold: expected a whole number that is not negative"),
        (["--hold", "4294967295"], "--hold and --ramp are at most 100000 cycles"),
        (["--cycle-ms", "4294967295"], "--cycle-ms from 1 to 1000"),
        (["--step", "nan"], "--step: expected finite numbers"),
        (["--step", "-1"], "--step has to be above zero"),
        (["--lowest", "1,1,1", "--highest", "0,2,2"], "--lowest is above --highest"),
        (["--lowest", "1,2,3,4,5,6,7"], "--lowest: expected finite numbers, six at the most, separated by commas"),
        (["--highest", "1"], "an option for all carts has fewer numbers than there are carts"),
        (["--kp", "1,,2"], "--kp: expected finite numbers"),
        (["--what", "1"], "--what: there is no such option; --help shows all"),
        (["--step"], "--step: this option lacks its value, or does not exist"),
    ],
)
def test_program_refuses_in_one_sentence(bench: Bench, words: list[str], sentence: str) -> None:
    command = [str(bench.program), *bench.options("egm", "trajectory"), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("gt_loop: ") and sentence in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_limits_and_the_switch_open_the_door(bench: Bench) -> None:
    """Beyond loopback the address is that of the robot: what comes from elsewhere is counted and not answered."""
    words = ["--allow", "192.0.2.1", "--beyond-loopback", "--lowest", text([-1.0] * 6), "--highest", text([1.0] * 6)]
    options = [w for w in bench.options("egm", "trajectory") if w != "--lockstep"]
    robot = bench.robot("egm")
    with LoopProcess(bench.program, [*options, *words]) as process:
        for _ in range(3):
            process.send(robot.datagram())
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(b"x", ("127.0.0.1", process.port))
        process.end()
        report = process.finish()
        assert process.received() == []
    assert report["foreign"] <= 4 and report["garbage"] == 0 and report["state"] == 0


def test_program_that_cannot_write_its_log_says_so(bench: Bench) -> None:
    with pytest.raises(LoopError, match="/nowhere/log: cannot write this log: No such file"):
        LoopProcess(bench.program, [*bench.options("egm", "trajectory"), "--log", "/nowhere/log"])


def test_silent_loop_is_ended_by_its_watchdog(bench: Bench) -> None:
    options = [*bench.options("rsi", "trajectory"), "--idle-ms", "50"]
    with LoopProcess(bench.program, options) as process:
        report = process.finish()
    assert report["cycles"] == 0 and report["log_complete"] == 1


def test_real_time_run_counts_every_deadline(bench: Bench) -> None:
    """The histogram is checked for being whole, not judged: other work shares the machine."""
    options = [w for w in bench.options("egm", "trajectory") if w != "--lockstep"]
    robot = bench.robot("egm")
    with LoopProcess(bench.program, options) as process:
        for _ in range(20):
            process.send(robot.datagram())
            answers: list[bytes] = []
            while not answers:
                answers = process.received()
            robot.step(answers)
        process.end()
        report = process.finish()
        said = process.printed
    assert report["cycles"] == sum(report["reply_below_us"].values()) == sum(report["period_below_us"].values())
    assert report["lost"] == 0
    assert report["fifo"] or "not real-time" in said


def test_adapter_leaves_out_what_the_folder_lacks(generated: Path) -> None:
    content = manifest_of(generated)
    whole = adapter(content, 3)
    assert (
        "gt_loop_model = {3U, gt_loop_model_forward, gt_loop_model_inverse_dynamics, gt_loop_model_carts, 0, NULL};"
        in whole
    )
    content["functions"] = [f for f in content["functions"] if f["name"] == "fk"]
    assert "gt_loop_model = {3U, gt_loop_model_forward, NULL, NULL, 0, NULL};" in adapter(content, 3)


def test_build_refuses_a_changed_folder(generated: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(generated, tmp_path / "copy"))
    (copy / "gt_l1.c").write_text("int x;\n")
    with pytest.raises(GenerationError, match="was changed since gtmodel wrote it"):
        build(copy, tmp_path / "loop", 3)
    with pytest.raises(GenerationError, match=r"was not written by gtmodel: it holds no manifest\.json; make it"):
        build(tmp_path / "nothing", tmp_path / "loop", 3)
    assert not (tmp_path / "loop" / PROGRAM).exists()


@pytest.mark.parametrize("spoilt", ["planted", "of others"])
def test_a_program_that_others_could_have_planted_is_built_anew(
    bench: Bench, generated: Path, tmp_path: Path, spoilt: str
) -> None:
    built_before(bench.place, tmp_path)  # with its stamp: built here, it would be the same
    program = build(generated, tmp_path, 3)
    whole, made = program.read_bytes(), program.stat().st_mtime_ns
    assert build(generated, tmp_path, 3).stat().st_mtime_ns == made, "a whole program is used again"
    if spoilt == "of others":
        program.chmod(0o777)
    else:
        program.write_bytes(b"#!/bin/sh\necho planted\n")
    again = build(generated, tmp_path, 3)
    assert again.stat().st_mtime_ns != made
    assert again.read_bytes() == whole and again.stat().st_mode & 0o022 == 0


def test_a_folder_of_another_gtmodel_is_named_as_such(generated: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(generated, tmp_path / "copy"))
    content = json.loads((copy / "manifest.json").read_text())
    old = {**content, "format": "gtmodel-c-1", "gtmodel": "0.0.7"}
    (copy / "manifest.json").write_text(json.dumps(old))
    with pytest.raises(GenerationError) as caught:
        manifest_of(copy)
    assert str(caught.value) == (
        f"folder: '{copy}' was generated by gtmodel 0.0.7 in a format that gtmodel {content['gtmodel']} does not "
        f"read; make it with gtmodel codegen PROBLEM.toml -o {copy}"
    )


def test_a_folder_in_float_serves_the_loop_in_double(functions: dict[str, CausalFunction], tmp_path: Path) -> None:
    """The laws see float's rounding and nothing else; what float cannot hold is no force."""
    folder = generate(functions, tmp_path / "f", name="l1f", real="float").folder
    build(folder, tmp_path / "loop", 3)  # warnings of conversion are errors
    place = tmp_path / "loop"
    (place / "main.c").write_text(CALLS)
    flags = ("-std=c99", "-O1", "-ffp-contract=off", f"-I{folder}", f"-I{place}")
    own = [folder / "gt_l1f.c", folder / "gt_l1f_body.c", place / "gt_loop_model.c", place / "main.c"]
    subprocess.run(["cc", *flags, *own, "-o", place / "calls", "-lm"], check=True)
    said = subprocess.run([place / "calls"], check=True, capture_output=True, text=True).stdout.splitlines()
    tcp, status = functions["fk"](np.array([-1.04, -1.14, -1.09]))
    assert said[0].split()[0] == said[1].split()[0] == "0" and status is Status.OK
    np.testing.assert_allclose([float(x) for x in said[0].split()[1:]], tcp, atol=1e-5, rtol=0)
    force, _ = functions["inverse_dynamics"](tcp, np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose([float(x) for x in said[1].split()[1:]], force, atol=1e-5 * np.abs(force).max(), rtol=0)
    assert said[2].split() == [str(int(Status.NOT_FINITE)), "7", "7", "7"]
