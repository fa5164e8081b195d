"""Synthetic logs of vendors get into an identification by the problem file alone, and planted slips are named.

The draws were stated beforehand: seeds FIRST + k, 30 logs for each vendor, 10 for each slip.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from scipy.stats import binom

import gtmodel as gt
from tests.identify.vendor_problems import NAMES, problem
from tests.support.commands import Commands
from tests.support.vendor_logs import SLIPS, VENDORS, Truth, clean, slipped

FIRST = 20261128
FAILED = {  # checks, one of which fails for a slip
    "sign": {"work_of_friction_J"},
    "unit": {"parameters_far_off"},
    "order": {"unexplained_share", "exchanged_columns"},
    "frame": {"deviations_beyond_bound"},
    "clock": {"delay_moves_a_parameter"},
}


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


def solved(gtmodel: Commands, truth: Truth, folder: Path) -> tuple[int, Any]:
    """Exit code and result of the problem of this log."""
    path = folder / "problem.toml"
    path.write_text(problem(truth), encoding="utf-8")
    done = gtmodel("solve", path, "--json", "--quiet")
    return done.code, done.json


def hits(result: Any, truth: Truth) -> list[bool]:
    """Whether the 95 % interval of each parameter contains the truth."""
    intervals = result["values"]["intervals"]
    return [n in intervals and intervals[n][0] <= truth.parameters[n] <= intervals[n][1] for n in NAMES]


def clean_faults(gtmodel: Commands, vendor: str, count: int, folder: Path) -> list[Any]:
    """Clean logs that do not get in, and parameters whose intervals hit outside the binomial 99 % band."""
    faults, found = list[Any](), []
    for k in range(count):
        truth = clean(vendor, FIRST + k, folder / str(k))
        code, result = solved(gtmodel, truth, folder / str(k))
        if code:
            faults.append((vendor, truth.seed, result["message"]))
        else:
            found.append(hits(result, truth))
    low, high = binom.ppf([0.005, 0.995], len(found), 0.95)
    counts = zip(NAMES, map(sum, zip(*found, strict=True)), strict=True)
    return faults + [(vendor, name, hit) for name, hit in counts if not low <= hit <= high]


def silent(gtmodel: Commands, slip: str, count: int, folder: Path) -> list[Any]:
    """Slips that fail no check that concerns them."""
    unnamed, vendors = list[Any](), tuple(VENDORS)
    for k in range(count):
        truth = slipped(vendors[k % len(vendors)], FIRST + k, folder / str(k), slip)
        code, result = solved(gtmodel, truth, folder / str(k))
        failed = {name for name, check in result["checks"].items() if not check["passed"]}
        if code != 1 or not failed & FAILED[slip]:
            unnamed.append((truth.vendor, truth.seed, truth.slip_in_words, failed))
    return unnamed


# a small draw each time, the stated one with the other statistics
SMALL, STATED = pytest.param(False), pytest.param(True, marks=pytest.mark.proof)


@pytest.mark.parametrize("stated", [SMALL, STATED])
@pytest.mark.parametrize("vendor", VENDORS)
def test_clean_logs_get_in_and_intervals_hold(gtmodel: Commands, vendor: str, stated: bool, tmp_path: Path) -> None:
    assert clean_faults(gtmodel, vendor, 30 if stated else 2, tmp_path) == []


@pytest.mark.parametrize("stated", [SMALL, STATED])
@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_named(gtmodel: Commands, slip: str, stated: bool, tmp_path: Path) -> None:
    assert silent(gtmodel, slip, 10 if stated else 1, tmp_path) == []


@pytest.mark.parametrize(
    ("vendor", "keys", "words"),
    [
        ("abb", "formats.*\n", ["tunemaster", "header = 7"]),
        ("abb", "since = .*\n", ["declare `since`"]),
        ("beckhoff", "header.*\n", ["line 1", "header = 6"]),
        ("beckhoff", ", per_channel = true", ["'Name' occurs 6 times", "per_channel = true"]),
        ("beckhoff", "empty_rows.*\n", ["line 7", 'empty_rows = "drop"']),
        ("beckhoff", r"quantity_unit = \[[^]]*\]\n", ["log.effort.quantity_unit"]),
    ],
)
def test_a_missing_key_is_named(gtmodel: Commands, vendor: str, keys: str, words: list[str], tmp_path: Path) -> None:
    text, found = re.subn(keys, "", problem(clean(vendor, FIRST, tmp_path)), count=1)
    assert found
    (tmp_path / "problem.toml").write_text(text, encoding="utf-8")
    done = gtmodel("solve", tmp_path / "problem.toml", "--quiet")
    assert done.code == 2 and all(word in done.err for word in words), done.err


@pytest.mark.parametrize(
    ("vendor", "file", "keys"),
    [
        ("abb", 0, ['column = ["sec", "usec"], unit = ["s", "us"]']),
        ("abb", 1, ["header = 7", 'time.since = "Log started"']),
        ("beckhoff", 0, ["header = 6", 'column = "Name", unit = "100 ns", per_channel = true', "empty_rows"]),
    ],
)
def test_inspect_suggests_the_keys(vendor: str, file: int, keys: list[str], tmp_path: Path) -> None:
    notes = gt.measurements.inspect(clean(vendor, FIRST, tmp_path).files[file]).notes
    assert all(any(key in note for note in notes) for key in keys), notes
