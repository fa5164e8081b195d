"""The hand-written C: guards take NaN for bad, comparisons see every difference, sentences exist."""

from pathlib import Path

from gtmodel import Status
from gtmodel._files import codegen_dir
from tests.cgen.conftest import succeed

PROGRAM = r"""
#include "gt_compare.h"
#include "gt_guard.h"
#include "gt_status.h"
#include <stdio.h>

int main(void)
{
    const double numbers[7] = {0.0, -DBL_MAX, DBL_MIN / 4.0, NAN, INFINITY, -INFINITY, 1.0};
    const double x[3] = {1.0, 200.0, 3.0};
    double y[3], worst = 0.0;
    int i, equal;

    for (i = 0; i < 7; i++) { (void)printf("%d", gt_all_finite(&numbers[i], 1)); }
    (void)printf(" %d%d%d\n", gt_all_finite(numbers, 3), gt_all_finite(numbers, 7), gt_all_finite(numbers, 0));
    gt_copy(y, x, 3);
    equal = gt_all_equal(y, x, 3, &worst);
    (void)printf("%d %g\n", equal, worst);
    y[1] = 202.0;
    equal = gt_all_equal(y, x, 3, &worst);
    (void)printf("%d %g\n", equal, worst);
    y[0] = 1.005;
    equal = gt_all_equal(y, x, 1, &worst);
    (void)printf("%d %g\n", equal, worst);
    y[2] = NAN;
    equal = gt_all_equal(y, x, 3, &worst);
    (void)printf("%d %g\n", equal, worst);
    for (i = -1; i < 8; i++) { (void)printf("%s\n", gt_status_sentence((gt_status)i)); }
    return 0;
}
"""


def test_runtime_headers(tmp_path: Path) -> None:
    (tmp_path / "program.c").write_text(PROGRAM)
    strict = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
    succeed("cc", *strict, f"-I{codegen_dir() / 'runtime'}", "program.c", "-lm", cwd=tmp_path)
    lines = succeed("./a.out", cwd=tmp_path).splitlines()
    assert lines[0] == "1110001 101"
    assert lines[1:5] == ["1 0", "0 0.01", "0 0.01", "0 inf"]
    unknown = "a status that does not exist"
    assert lines[5:] == [unknown, *[s.message for s in Status], unknown]


def test_hand_written_files_are_small() -> None:
    for path in (codegen_dir() / "runtime").iterdir():
        assert len(path.read_text().splitlines()) < 250
