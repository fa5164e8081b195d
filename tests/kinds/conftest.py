"""What holds for all tests of kinds: a refusal names a key that the file can have."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import pydantic
import pytest

from gtmodel.problem_files import from_options, run

NOT_OF_A_FILE = {"folder"}
"""Arguments that only a call has: where generated code goes."""


def is_key(schema: type[pydantic.BaseModel], place: str) -> bool:
    """True for a key or a table of this schema, with indices of lists, also below a table with free names."""
    for key in from_options.keys_of(schema):
        parts = [r"[^.]+" if part == "*" else rf"{re.escape(part.removesuffix('[]'))}(\[\d+\])*"
                 for part in key.key.split(".")]  # fmt: skip
        pattern = parts[-1] + (r"(\..+)?" if key.type.startswith("table") else "")
        for part in reversed(parts[:-1]):
            pattern = rf"{part}(\.{pattern})?"
        if re.fullmatch(pattern, place):
            return True
    return False


@pytest.fixture(autouse=True)
def refusals_name_a_key(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    wrong: list[str] = []

    def key_of(schema: type[pydantic.BaseModel], argument: str, renamed: Mapping[str, str]) -> str:
        key = from_options.key_of(schema, argument, renamed)
        if key and key not in NOT_OF_A_FILE and not key.startswith("--") and not is_key(schema, key):
            wrong.append(
                f"the study refuses the argument '{argument}', but the file has no key '{key}': map it in ARGUMENTS of "
                f'{schema.__module__}, or raise it under `with naming("robot")`, with the argument of the study'
            )
        return key

    monkeypatch.setattr(run, "key_of", key_of)
    yield
    assert not wrong, wrong[0]
