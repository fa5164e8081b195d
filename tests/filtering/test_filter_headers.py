"""The hand-written C of filters: counts of cppcheck's MISRA addon, which may only fall. No claim of compliance."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from gtmodel._files import codegen_dir

RUNTIME = codegen_dir() / "runtime"
# what cppcheck is to take for the numbers of float.h, which it does not read: without them gt_float.h ends the file
FLOATS = {"FLT_RADIX": 2, "DBL_MANT_DIG": 53, "DBL_MAX_EXP": 1024, "FLT_MANT_DIG": 24, "FLT_MAX_EXP": 128}
# 11.8: pointers to numbers are members of structs that are const themselves; 15.5: a refused input returns early
MOST = {"11.8": 15, "15.5": 1}


@pytest.mark.proof
def test_misra_counts_of_filters_only_fall(tmp_path: Path) -> None:
    tool = shutil.which("cppcheck")
    if tool is None:
        pytest.skip("not run: cppcheck is not installed (apt install cppcheck)")
    (tmp_path / "one.c").write_text('#include "gt_filter.h"\n')
    command = [tool, "--addon=misra", "--std=c99", "--quiet", f"-I{RUNTIME}", "--template={id} {file}"]
    command += [f"-D{name}={value}" for name, value in FLOATS.items()]
    done = subprocess.run([*command, str(tmp_path / "one.c")], capture_output=True, text=True, timeout=600)
    counts = Counter(re.findall(r"^misra-c2012-([\d.]+) .*gt_filter\w*\.h$", done.stderr, re.MULTILINE))
    assert counts, "the addon sees nothing at all: did it run?"
    assert {rule: n for rule, n in counts.items() if n > MOST.get(rule, 0)} == {}
