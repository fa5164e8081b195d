"""The pages of the site are true: their Python and their commands run, every kind has a page, every name an entry."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from docs._ext.public_names import LIBRARIES, public
from docs._ext.reference import page
from docs._ext.runs import run_in
from gtmodel.problem_files import registry

CLONE = Path(__file__).parents[1]
DOCS = CLONE / "docs"
PAGES = sorted(p for p in DOCS.rglob("*.md") if not {"_made", "notebooks", "reference"} & set(p.parts))
LONG = "<!-- long -->"  # stands in a line above a fence that takes more than some seconds: it runs in `make proof`

LANGUAGES = {"python", "sh", "text", "toml", "c", "modelica", "matlab"} | {
    f"{{{name}}}" for name in ("run", "problem", "keys", "gallery", "toctree", "include", "figure", "image")
}
"""Those that only show something, such as another tool's language, stand beside those that are run."""


class Fence(NamedTuple):
    info: str
    text: str
    long: bool
    line: int


def fences(page: Path) -> list[Fence]:
    text = page.read_text(encoding="utf-8")
    pattern = re.compile(r"^(?P<mark>```+)(?P<info>.*)\n(?P<body>(?:.*\n)*?)(?P=mark)$", re.M)
    return [
        Fence(
            m["info"].strip(), m["body"], text[: m.start()].rstrip().endswith(LONG), text[: m.start()].count("\n") + 1
        )
        for m in pattern.finditer(text)
    ]


def commands(fence: Fence) -> list[str]:
    """The calls of gtmodel in a fence of a shell or of the directive `run`."""
    if fence.info not in ("sh", "{run}"):
        return []
    lines = fence.text.replace("\\\n", " ").splitlines()
    return [line.split("  #")[0].strip() for line in lines if line.startswith("gtmodel ")]


def expected(fence: Fence) -> int:
    status = re.search(r"^:status: (\d)$", fence.text, re.M)
    return int(status[1]) if status else 0


def named(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


def pages_with(long: bool) -> list[Any]:
    return [pytest.param(p, id=named(p)) for p in PAGES if any(f.long is long for f in fences(p))]


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the shipped problems in it, as a clone has."""
    for name in ("problems", "notebooks"):
        (tmp_path / name).symlink_to(CLONE / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_python(page: Path, long: bool) -> None:
    """Fences of a page see what those above them made; `long` or not: up to the first long one, or all."""
    scope: dict[str, Any] = {"__name__": "page"}
    for fence in fences(page):
        if fence.info != "python":
            continue
        if fence.long and not long:
            return
        exec(compile("\n" * fence.line + fence.text, str(page), "exec"), scope)


def run_commands(page: Path, work: Path, long: bool) -> None:
    for fence in fences(page):
        for command in commands(fence):
            if fence.long is long:
                code, text = run_in(work, shlex.split(command)[1:])
                assert code == expected(fence), f"{page.name} line {fence.line}: {command}\n{text[-2000:]}"


@pytest.mark.parametrize("page", pages_with(False))
def test_what_a_page_shows_runs(page: Path, work: Path) -> None:
    run_python(page, long=False)
    run_commands(page, work, long=False)


@pytest.mark.proof
@pytest.mark.parametrize("page", pages_with(True))
def test_what_takes_long_on_a_page_runs(page: Path, work: Path) -> None:
    run_python(page, long=True)
    run_commands(page, work, long=True)


@pytest.mark.proof
def test_the_site_is_built_without_a_warning() -> None:
    subprocess.run(["make", "docs", f"VENV={Path(sys.prefix)}"], cwd=CLONE, check=True)


@pytest.mark.parametrize("page", [pytest.param(p, id=named(p)) for p in PAGES])
def test_every_fence_is_of_a_language_that_is_tested(page: Path) -> None:
    tested = {
        "python",
        "sh",
        "text",
        "toml",
        "c",
        "{run}",
        "{toctree}",
        "{gallery}",
        "{include}",
        "{figure}",
        "{image}",
    }
    other = (
        {f.info.split()[0] if f.info else "" for f in fences(page)}
        - tested
        - {"{problem}", "{keys}", "modelica", "matlab"}
    )
    assert not other


def directive(page: Path, name: str) -> list[str]:
    return [f.info.split()[1] for f in fences(page) if f.info.startswith(f"{{{name}}} ")]


@pytest.mark.parametrize("kind", list(registry.names()))
def test_every_kind_has_a_page_with_its_keys_and_a_problem(kind: str) -> None:
    page = DOCS / "kinds" / f"{kind}.md"
    assert directive(page, "keys") == [kind]
    problems = directive(page, "problem")
    assert problems
    for problem in problems:
        text = (CLONE / "problems" / f"{problem}.toml").read_text(encoding="utf-8")
        assert re.search(rf'^kind = "{kind}"', text, re.M), problem


def test_every_page_is_reached_from_the_first() -> None:
    seen, left = set(), [DOCS / "index.md"]
    while left:
        page = left.pop()
        seen.add(page)
        for fence in fences(page):
            if fence.info == "{toctree}":
                entries = [e.split("<")[-1].rstrip(">") for e in fence.text.split("\n") if e and not e.startswith(":")]
                left += [p for e in entries if (p := (page.parent / f"{e}.md").resolve()) in PAGES and p not in seen]
    assert not {named(p) for p in PAGES} - {named(p) for p in seen}


def test_the_reference_describes_every_public_object() -> None:
    written = "\n".join(line for library in ["", *LIBRARIES] for line in page(library))
    for library in ["", *LIBRARIES]:
        for name in public(library):
            full = f"gtmodel.{library}.{name}".replace("..", ".")
            assert re.search(rf":: {re.escape(full)}$|^- ``{name}``: ", written, re.M), full
