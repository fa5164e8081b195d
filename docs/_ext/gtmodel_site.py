"""Sphinx extension of this site: commands with their real output, keys of a kind, the reference, mathematics.

Directives of the pages:

    ```{run}              commands of the command line, with what they print
    ```{problem} NAME     a shipped problem: its file, its command, its table and pictures; options `pictures`: which of
                          them, `settings`: KEY=VALUE ... behind --set
    ```{keys} KIND        the keys of a problem file and the names of the results, as `gtmodel schema` gives them
    ```{gallery}          a picture of every page that solves a problem
    ```{view} NAME        the motion that a shipped problem computes, in space
    ```{theses}           the rows of docs/theses.toml

What commands print is kept in build/site/runs until gtmodel or the problem changes.
"""

from __future__ import annotations

import inspect
import re
import shutil
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.ext.autodoc.preserve_defaults import update_default_value
from sphinx.util.docutils import SphinxDirective

import gtmodel as gt
from gtmodel.problem_files import editor_schema

from . import fences, links, reference, runs, theses

DOCS = Path(__file__).parents[1]
CLONE = DOCS.parent
TEXTS = ("NOTATION", "CHANGELOG", "ARCHITECTURE", "CONTRIBUTING", "SECURITY")


class _Page(SphinxDirective):
    """Writes Markdown and lets the page's own parser read it."""

    def markdown(self, text: str) -> list[nodes.Node]:
        holder = nodes.container()
        self.state.nested_parse(StringList(text.splitlines(), self.get_source_info()[0]), self.content_offset, holder)
        return holder.children

    def console(self, command: str, output: str) -> list[nodes.Node]:
        block = nodes.literal_block(f"$ {command}\n{output}", f"$ {command}\n{output}", language="console")
        return [block]


class Run(_Page):
    """Commands, a line each, and what each prints.

    Options: `status`, the exit code that is expected, 0 if left out; `pictures`, which of theirs are shown.
    """

    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {"status": directives.nonnegative_int, "pictures": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        page = Path(self.env.doc2path(self.env.docname))
        own = runs.run_page(page) if fences.files_of(page) else None
        made: list[nodes.Node] = []
        pictures = self.options.get("pictures", "").split()
        for command in self.content:
            result = runs.run(command) if own is None else own[command.split("  #")[0].strip()]
            if result.code != self.options.get("status", 0):
                raise self.error(f"'{command}' ended with {result.code}: {result.text[-500:]}")
            made += self.console(command, result.text)
            for picture in [p for p in pictures if p in {one.name for one in result.pictures}]:
                pictures.remove(picture)
                path = _shown(result, picture, self.env.docname.replace("/", "_"), self)
                made += self.markdown(f"```{{image}} /{path}\n:alt: {Path(picture).stem}\n```")
        if pictures:
            raise self.error(f"nothing here draws {', '.join(pictures)}")
        return made


class View(_Page):
    """The motion of a shipped problem, to be turned and played."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        self.env.note_dependency(str(CLONE / "problems" / f"{self.arguments[0]}.toml"))
        return [nodes.raw("", gt.load(self.arguments[0])().view()._repr_html_(), format="html")]


class Problem(_Page):
    """A shipped problem: file, command, table, pictures."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {"pictures": directives.unchanged, "settings": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        name = self.arguments[0]
        file = CLONE / "problems" / f"{name}.toml"
        self.env.note_dependency(str(file))
        command = _command(name, self.options.get("settings", ""))
        result = runs.run(command)
        if result.code != 0:
            raise self.error(f"'{command}' ended with {result.code}: {result.text[-500:]}")
        made = self.markdown(
            f"```{{literalinclude}} {links.up(self.env.docname)}problems/{name}.toml\n:language: toml\n```"
        )
        made += self.console(command, result.text)
        wanted = self.options.get("pictures", "").split() or [p.name for p in result.pictures]
        for picture in wanted:
            path = _shown(result, picture, name, self)
            made += self.markdown(f"```{{image}} /{path}\n:alt: {Path(picture).stem} of {name}\n```")
        return made


class Keys(_Page):
    """Tables of the keys of a kind and of the names of its results."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        document = editor_schema.document(self.arguments[0])
        keys = [[f"`{k['key']}`", k["type"], _unit(k["unit"]), _code(k["default"]), k["description"] or ""]
                for k in document["keys"]]  # fmt: skip
        made = _table(["key", "type", "unit", "default", "description"], keys)
        values = [[f"`{name}`", _unit(v["unit"]), v["description"]] for name, v in document["values"].items()]
        text = f"Keys of the problem file:\n\n{made}\n\nNames in `result.json`, under `values`:\n\n"
        holder = nodes.container(classes=["keys"])
        holder += self.markdown(text + _table(["name", "unit", "description"], values))
        return [holder]


class Gallery(_Page):
    """The first picture of every page of a kind, with a link to it."""

    def run(self) -> list[nodes.Node]:
        made: list[nodes.Node] = []
        for page in sorted((DOCS / "kinds").glob("*.md")):
            title = page.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
            for fence in fences.fences(page):
                if not fence.info.startswith("{problem} "):
                    continue
                name = fence.info.split()[1]
                result = runs.run(_command(name, fence.option("settings")))
                for picture in (fence.option("pictures").split() or [p.name for p in result.pictures])[:1]:
                    path = _shown(result, picture, name, self)
                    made += self.markdown(
                        f"```{{figure}} /{path}\n:target: {page.stem}.html\n:figclass: gallery\n"
                        f":alt: {title}, {name}\n\n{title}: `{name}`\n```"
                    )
        return made


class Theses(_Page):
    """Printed numbers of the theses beside ours."""

    def run(self) -> list[nodes.Node]:
        self.env.note_dependency(str(theses.FILE))
        holder = nodes.container(classes=["theses"])
        holder += self.markdown("\n".join(theses.lines()))
        return [holder]


def _command(problem: str, settings: str) -> str:
    settings = "".join(f" --set {setting}" for setting in settings.split())
    if 'kind = "codegen"' in (CLONE / "problems" / f"{problem}.toml").read_text(encoding="utf-8"):
        return f"gtmodel codegen problems/{problem}.toml{settings} -o out --check"
    return f"gtmodel solve problems/{problem}.toml{settings} --plot --out out"


def _shown(result: runs.Result, picture: str, name: str, directive: _Page) -> str:
    """The path under docs/ of a copy of a picture that a command drew."""
    source = next((p for p in result.pictures if p.name == picture), None)
    if source is None:
        raise directive.error(f"{name} draws no {picture}; it draws {[p.name for p in result.pictures]}")
    target = DOCS / "_made" / name / picture
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
    return target.relative_to(DOCS).as_posix()


def _unit(text: str) -> str:
    """A unit as one writes it: µm for um, N m for N.m."""
    return re.sub(r"\bu(m|rad)\b", r"µ\1", text).replace(".", " ")


def _code(value: object) -> str:
    text = str(value if value is not None else "")
    return text if not text or text.startswith("required") else f"`{text}`"


def _table(header: list[str], rows: list[list[str]]) -> str:
    def cell(text: object) -> str:
        return inspect.cleandoc(str(text)).replace("\n", " ").replace("|", "\\|")

    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines)


def _copied_notebooks(app: Sphinx) -> None:
    """The percent notebooks beside the pages: Sphinx reads what stands under its own folder."""
    folder = DOCS / "notebooks"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for script in sorted((CLONE / "notebooks").glob("[0-9][0-9]_*.py")):
        shutil.copyfile(script, folder / script.name)
    scripts = sorted(folder.glob("*.py"))
    listed = "\n".join(f"- {{doc}}`{p.stem}`: {_question(p)}" for p in scripts)
    names = "\n".join(p.stem for p in scripts)
    text = (
        "# Notebooks\n\nEach asks one question. They were run when this site was built.\n\n"
        f"{listed}\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"
    )
    (folder / "index.md").write_text(text, encoding="utf-8")


def _question(script: Path) -> str:
    """What a notebook asks: its first bold sentence."""
    asked = re.search(r"^# \*\*(.+?)\*\*$", script.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    if asked is None:
        raise ValueError(f"{script.name} asks no question in bold under its title")
    return asked[1].replace("\n# ", " ")


def _copied_texts(app: Sphinx) -> None:
    """What stands at the top of the clone, as pages; links between these texts lead from page to page."""
    folder = DOCS / "project"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name in TEXTS:
        text = (CLONE / f"{name}.md").read_text(encoding="utf-8")
        for other in TEXTS:
            text = text.replace(f"]({other}.md", f"]({other.lower()}.md")
        (folder / f"{name.lower()}.md").write_text(text, encoding="utf-8")


def _links(app: Sphinx, page: str, content: list[str]) -> None:
    content[0] = links.on_the_site(page, content[0])


def _as_written(app: Sphinx, obj: Any, bound_method: bool) -> None:
    """Show defaults and a study's `**work_options` as the source has them.

    Sphinx's autodoc_preserve_defaults does this too early: the signature of a study has more arguments than its source.
    """
    if hasattr(obj, "__wrapped__"):
        vars(obj).pop("__signature__", None)
    update_default_value(obj, bound_method)


def _mathml(self: Any, node: nodes.Element) -> None:
    """LaTeX as MathML, which every browser shows without a script."""
    block = isinstance(node, nodes.math_block)
    self.body.append(tex2mathml(node.astext(), as_block=block))
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers what the pages use."""
    for name, directive in (
        ("run", Run),
        ("problem", Problem),
        ("keys", Keys),
        ("gallery", Gallery),
        ("theses", Theses),
        ("view", View),
    ):
        app.add_directive(name, directive)
    app.add_html_math_renderer("mathml", (_mathml, None), (_mathml, None))
    app.connect("builder-inited", _copied_notebooks)
    app.connect("builder-inited", _copied_texts)
    app.connect("builder-inited", reference.write)
    app.connect("source-read", _links)
    app.connect("autodoc-before-process-signature", _as_written)
    app.connect("autodoc-process-docstring", reference.kept_from_napoleon, priority=100)
    app.connect("autodoc-process-docstring", reference.docstring, priority=900)
    app.connect("autodoc-process-signature", reference.signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
