"""Status tables: values that C relies on, and the generated C compiled and compared with Python."""

from __future__ import annotations

import json
import pickle
import shutil
import subprocess
from pathlib import Path

import pytest

from gtmodel.results import SolveStatus, Status, c_enum, c_sentences

EXPECTED_ENUM = """\
typedef enum gt_status {
    GT_OK = 0, /* the value was computed */
    GT_OUT_OF_RANGE = 1, /* the input lies outside the range where a solution exists */
    GT_NOT_CONVERGED = 2, /* the iteration did not converge within its limit */
    GT_SINGULAR = 3, /* the equations are singular at this point */
    GT_NOT_FINITE = 4, /* a number that is not finite went in or came out */
    GT_STALE_INPUT = 5, /* the input is older than the loop allows */
    GT_WRONG_BRANCH = 6 /* the iteration led to a solution on another than the wanted branch */
} gt_status;
"""


def test_only_ok_is_ok() -> None:
    assert [s for s in Status if s.ok] == [Status.OK]


def test_numbers_are_fixed() -> None:
    assert {s.name: int(s) for s in Status} == {
        "OK": 0,
        "OUT_OF_RANGE": 1,
        "NOT_CONVERGED": 2,
        "SINGULAR": 3,
        "NOT_FINITE": 4,
        "STALE_INPUT": 5,
        "WRONG_BRANCH": 6,
    }
    assert Status(3) is Status.SINGULAR
    assert [s.c_name for s in Status][:2] == ["GT_OK", "GT_OUT_OF_RANGE"]
    with pytest.raises(ValueError, match="7 is not a valid Status"):
        Status(7)


def test_words_are_fixed() -> None:
    words = [
        "solved",
        "check_failed",
        "infeasible",
        "iteration_limit",
        "interrupted",
        "not_finite",
        "diverged",
        "bad_input",
        "failed",
    ]
    assert [s.value for s in SolveStatus] == words
    assert [str(s) for s in SolveStatus] == words
    assert [f"{s}" for s in SolveStatus] == words
    assert SolveStatus("diverged") is SolveStatus.DIVERGED
    assert json.dumps({"status": SolveStatus.SOLVED}) == '{"status": "solved"}'


def test_only_solved_is_ok() -> None:
    assert [s for s in SolveStatus if s.ok] == [SolveStatus.SOLVED]


@pytest.mark.parametrize("member", [*Status, *SolveStatus])
def test_sentences_are_plain_and_fit_into_c(member: Status | SolveStatus) -> None:
    assert member.message.isascii() and member.message.isprintable()
    assert not set('"\\') & set(member.message) and "*/" not in member.message
    assert member.message[0].islower() and not member.message.endswith(".")
    assert pickle.loads(pickle.dumps(member)) is member


def test_no_sentence_is_used_twice() -> None:
    for table in (Status, SolveStatus):
        assert len({s.message for s in table}) == len(table)


def test_text_of_the_c_enumeration() -> None:
    assert c_enum() == EXPECTED_ENUM
    assert c_enum() == c_enum() and c_sentences() == c_sentences()


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_c_agrees_with_python(tmp_path: Path) -> None:
    prints = "".join(f'    printf("%d %s\\n", (int){s.c_name}, gt_status_sentences[{s.c_name}]);\n' for s in Status)
    count = '    printf("%u\\n", (unsigned)(sizeof gt_status_sentences / sizeof *gt_status_sentences));\n'
    source = tmp_path / "status.c"
    source.write_text(
        f"#include <stdio.h>\n\n{c_enum()}\n{c_sentences()}\nint main(void)\n{{\n{prints}{count}    return GT_OK;\n}}\n"
    )
    program = tmp_path / "status"
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-o", program, source], check=True)
    printed = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    assert printed == "".join(f"{s.value} {s.message}\n" for s in Status) + f"{len(Status)}\n"
