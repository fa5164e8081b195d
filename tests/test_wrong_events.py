"""Wrong models with events, tests/suites/wrong_events.toml: each ends with its sentence, naming the line to blame."""

import linecache
import re
import textwrap
import tomllib
from pathlib import Path
from typing import Any

import pytest

SUITE = tomllib.loads((Path(__file__).parent / "suites" / "wrong_events.toml").read_text(encoding="utf-8"))
LONGEST = 400  # characters of a sentence, places included


def test_suite_is_large_enough() -> None:
    assert len(SUITE) >= 30


@pytest.mark.parametrize("name", sorted(SUITE))
def test_wrong_model_gets_its_sentence(name: str) -> None:
    case = SUITE[name]
    before = case.get("before", "").strip()
    source = f"import gtmodel as gt\nfrom gtmodel import der\n{before}\nclass M(gt.Model):\n"
    source += textwrap.indent(f"\n{case['model'].strip()}\n", "    ")
    source += f"\nmodel = {case.get('make', 'M()')}\nmodel.{case.get('ask', 'simulate(2.0)')}\n"
    file = f"suite/{name}.py"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope: dict[str, Any] = {"__name__": name}
    with pytest.raises((ValueError, TypeError, RuntimeError)) as caught:
        exec(compile(source, file, "exec"), scope)
    sentence = str(caught.value)
    assert re.search(case["sentence"], sentence), f"\nfound    {sentence}\nexpected {case['sentence']}"
    assert "\n" not in sentence, "one sentence, not a listing"
    assert len(sentence) <= LONGEST
