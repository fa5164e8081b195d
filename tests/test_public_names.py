"""Every public name with its arguments, as `tests/public_names.txt` lists them: what a reader's own code calls.

python -m tests.test_public_names      writes the list again; a name that goes or changes needs a line in CHANGELOG.md
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import gtmodel as gt

LIST = Path(__file__).with_name("public_names.txt")


def written(name: str, value: Any) -> str:
    """A name with the names of its arguments; `=` behind those that may be left out."""
    if not callable(value):
        return name
    try:
        given = inspect.signature(value)
    except (TypeError, ValueError):
        return f"{name}()"
    bare = [
        p.replace(annotation=p.empty, default=p.empty if p.default is p.empty else _Omissible())
        for p in given.parameters.values()
    ]
    text = str(given.replace(parameters=bare, return_annotation=given.empty))
    return f"{name}{text}"


class _Omissible:
    def __repr__(self) -> str:
        return ""


def names(package: ModuleType, seen: set[str]) -> Iterator[str]:
    """Public names of a package, of the packages in it, and the public methods of its classes."""
    seen.add(package.__name__)
    public: dict[str, tuple[str, str]] = vars(package).get("_public", {})
    for name in sorted({*public, *getattr(package, "__all__", ())}):
        value, full = getattr(package, name), f"{package.__name__}.{name}"
        if isinstance(value, ModuleType):
            if "_public" in vars(value) and value.__name__ not in seen:
                yield from names(value, seen)
            continue
        yield written(full, value)
        if inspect.isclass(value) and value.__module__.startswith("gtmodel"):
            for member in sorted(vars(value)):
                if not member.startswith("_"):
                    yield written(f"{full}.{member}", inspect.getattr_static(value, member))


def test_public_names_are_those_of_the_list() -> None:
    now, before = set(names(gt, set())), set(LIST.read_text().splitlines())
    assert sorted(before - now) == [], (
        "went or changed: needs a line in CHANGELOG.md, and the old name is read for one release"
    )
    assert sorted(now - before) == [], "came: write the list again, python -m tests.test_public_names"


if __name__ == "__main__":
    LIST.write_text("\n".join(sorted(names(gt, set()))) + "\n")
