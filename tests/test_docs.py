"""The pages of the site are true: their Python and their commands run, every kind has a page, every name an entry.

`make test` runs a fifth of the pages, `make proof` the others; one page: pytest tests/test_docs.py -m "" -k kinds/reach
"""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

from docs._ext.fences import Run, fences, importable, run_page
from docs._ext.links import on_the_site
from docs._ext.public_names import LIBRARIES, public
from docs._ext.reference import _plain_text, page
from gtmodel.cli import main
from gtmodel.problem_files import registry
from tests.support.parts import a_fifth

CLONE = Path(__file__).parents[1]
DOCS = CLONE / "docs"
MADE = {"_made", "notebooks", "project", "reference"}
PAGES = sorted(p for p in DOCS.rglob("*.md") if not MADE & set(p.relative_to(DOCS).parts))
MARKDOWN = [
    *PAGES,
    *CLONE.glob("*.md"),
    *CLONE.glob(".github/**/*.md"),
    *CLONE.glob("codegen/**/*.md"),
    *CLONE.glob("problems/**/*.md"),
]
LANGUAGES = {"python", "sh", "text", "toml", "xml", "c", "modelica", "matlab"} | {
    f"{{{name}}}"
    for name in ("run", "problem", "keys", "gallery", "theses", "view", "toctree", "include", "figure", "image")
}
"""Those that only show something, such as another tool's language, stand beside those that are run."""


def named(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


def failed(page: Path, folder: Path, *, long: bool, run: Run | None = None) -> list[str]:
    """What ends with another status than the page says."""
    return [
        f"{page.name} line {fence.line}: {command}\n{text[-2000:]}"
        for fence, command, code, text in run_page(page, folder, long=long, run=run) if code != fence.status
    ]  # fmt: skip


# tests/sweep starts the same workers
SHORT = a_fifth([p for p in PAGES if any(not f.long for f in fences(p))], named, later={"howto/sweeps.md"})


@pytest.mark.parametrize("page", SHORT)
def test_what_a_page_shows_runs(page: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """In this process; `make proof` runs the longer pages, and `make docs` all, by processes of their own."""

    def run(work: Path, words: list[str]) -> tuple[int, str]:
        with contextlib.chdir(work), importable(work):
            code = main(words)
        return code, "".join(capfd.readouterr())

    assert failed(page, tmp_path, long=False, run=run) == []


@pytest.mark.proof
@pytest.mark.parametrize("page", [pytest.param(p, id=named(p)) for p in PAGES if any(f.long for f in fences(p))])
def test_what_a_page_shows_and_takes_long_runs(page: Path, tmp_path: Path) -> None:
    assert failed(page, tmp_path, long=True) == []


@pytest.mark.proof
def test_the_site_is_built_without_a_warning() -> None:
    done = subprocess.run(
        ["make", "docs", f"VENV={Path(sys.prefix)}"], cwd=CLONE, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert (CLONE / "build" / "site" / "html" / "index.html").is_file()


@pytest.mark.parametrize("page", [pytest.param(p, id=named(p)) for p in PAGES])
def test_every_fence_is_of_a_language_that_is_tested(page: Path) -> None:
    tested = {
        "python",
        "sh",
        "text",
        "toml",
        "xml",
        "c",
        "{run}",
        "{toctree}",
        "{gallery}",
        "{theses}",
        "{include}",
        "{literalinclude}",
        "{figure}",
        "{image}",
    }
    other = (
        {f.info.split()[0] if f.info else "" for f in fences(page)}
        - tested
        - {"{problem}", "{keys}", "{view}", "modelica", "matlab"}
    )
    assert not other


def directive(page: Path, name: str) -> list[str]:
    return [f.info.split()[1] for f in fences(page) if f.info.startswith(f"{{{name}}} ")]


@pytest.mark.parametrize("kind", list(registry.names()))
def test_every_kind_has_a_page_with_its_keys_and_a_problem(kind: str) -> None:
    page = DOCS / "kinds" / f"{kind}.md"
    assert page.is_file(), f"kind '{kind}' has no page: write docs/kinds/{kind}.md"
    assert directive(page, "keys") == [kind], f"{page.name} needs a fence ```{{keys}} {kind}"
    problems = directive(page, "problem")
    assert problems, f"{page.name} needs a fence ```{{problem}} with the name of a shipped problem"
    for problem in problems:
        text = (CLONE / "problems" / f"{problem}.toml").read_text(encoding="utf-8")
        assert re.search(rf'^kind = "{kind}"', text, re.M), f"{problem} is of another kind than {page.name}"


@pytest.mark.parametrize("page", [pytest.param(p, id=named(p)) for p in PAGES])
def test_pictures_are_named_one_by_one(page: Path) -> None:
    """With blanks between them, as the site reads them; whether they are drawn is known when it is built."""
    named_there = re.findall(r"^:pictures:(.*)$", page.read_text(encoding="utf-8"), flags=re.M)
    assert not [name for line in named_there for name in line.split() if not re.fullmatch(r"[\w-]+\.png", name)]


def test_every_page_is_reached_from_the_first() -> None:
    seen, left = set(), [DOCS / "index.md"]
    while left:
        page = left.pop()
        seen.add(page)
        for fence in fences(page):
            if fence.info == "{toctree}":
                entries = [e.split("<")[-1].rstrip(">") for e in fence.text.split("\n") if e and not e.startswith(":")]
                left += [p for e in entries if (p := (page.parent / f"{e}.md").resolve()) in PAGES and p not in seen]
    missing = sorted({named(p) for p in PAGES} - {named(p) for p in seen})
    assert not missing, f"no toctree lists {', '.join(missing)}"


@pytest.mark.parametrize("page", [pytest.param(p, id=p.relative_to(CLONE).as_posix()) for p in MARKDOWN])
def test_every_link_leads_to_a_file_of_the_clone(page: Path) -> None:
    """As a forge reads it, which shows the clone and knows nothing of the site."""
    text = re.sub(r"^(```+).*?^\1$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    links = re.findall(r"\]\(((?!https?:|mailto:|#)[^)\s#]+)", text)
    assert not [link for link in links if not (page.parent / link).exists()]
    assert not {p for link in links if MADE & set((p := (page.parent / link).resolve().relative_to(CLONE)).parts[1:2])}


def test_links_to_files_of_the_clone_lead_to_pages_of_the_site() -> None:
    written = {f"reference/gtmodel.{name}" for name in LIBRARIES} | {"reference/index"}
    written |= {f"notebooks/{p.stem}" for p in (CLONE / "notebooks").glob("[0-9]*.py")}
    for source in PAGES:
        links = re.findall(r"\]\(((?:\.\./)+(?:notebooks|gtmodel)[^)]*)", source.read_text(encoding="utf-8"))
        name = named(source).removesuffix(".md")
        for link in links:
            (to,) = re.findall(r"\((.*)\)", on_the_site(name, f"[x]({link})"))
            assert (source.parent / to).resolve().relative_to(DOCS).as_posix() in written, link


def test_docstrings_become_text_that_the_site_can_set() -> None:
    """Letters right behind a name in backticks, and signs that are no markup."""
    assert _plain_text("`Part`s of ``x``y, a*b") == r"`Part`\ s of ``x``\ y, a\*b"


def test_the_reference_describes_every_public_object() -> None:
    written = "\n".join(line for library in ["", *LIBRARIES] for line in page(library))
    for library in ["", *LIBRARIES]:
        for name in public(library):
            full = f"gtmodel.{library}.{name}".replace("..", ".")
            assert re.search(rf":: {re.escape(full)}$|^- ``{name}``: ", written, re.M), full
