"""Files for contributors and for the forge: they parse, what they name is there, and versions agree."""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from gtmodel._version import __version__

CLONE = Path(__file__).resolve().parents[1]
GITHUB = CLONE / ".github"
FORMS = sorted(p for p in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml") if p.name != "config.yml")
WORKFLOWS = [".github/workflows/test.yml", ".github/workflows/release.yml"]
PAGES = ["CONTRIBUTING.md", "SECURITY.md", "ARCHITECTURE.md", ".github/pull_request_template.md"]


def read_yaml(name: str) -> Any:
    return yaml.safe_load((CLONE / name).read_text(encoding="utf-8"))


def targets() -> set[str]:
    return set(re.findall(r"^([a-z]+):", (CLONE / "Makefile").read_text(), flags=re.MULTILINE))


def test_versions_agree() -> None:
    project = tomllib.loads((CLONE / "pyproject.toml").read_text())["project"]
    released = re.findall(
        r"^## \[(\d[\w.]*)\] - (\d{4}-\d\d-\d\d)$", (CLONE / "CHANGELOG.md").read_text(), re.MULTILINE
    )
    citation = read_yaml("CITATION.cff")
    assert project["version"] == __version__ == citation["version"] == released[0][0]
    assert str(citation["date-released"]) == released[0][1]


def test_the_changelog_has_one_unreleased_section_on_top() -> None:
    heads = re.findall(r"^## (.*)$", (CLONE / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert heads[0] == "[Unreleased]" and heads.count("[Unreleased]") == 1
    assert all(re.fullmatch(r"\[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", head) for head in heads[1:])


def test_the_citation_has_what_a_citation_needs() -> None:
    citation = read_yaml("CITATION.cff")
    assert {"cff-version", "message", "title", "authors", "type"} <= set(citation)
    assert citation["cff-version"] == "1.2.0" and citation["type"] == "software" and citation["license"] == "MIT"
    assert citation["authors"] == [{"name": "The gtmodel authors"}]
    theses = {(r["authors"][0]["family-names"], r["year"]) for r in citation["references"]}
    assert theses == {("Dressler", 2012), ("Cvitanic", 2021)}
    for reference in citation["references"]:
        assert {"type", "title", "authors", "institution"} <= set(reference) and reference["type"] == "thesis"


@pytest.mark.parametrize("path", FORMS, ids=lambda p: p.stem)
def test_a_form_for_issues_is_one(path: Path) -> None:
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= set(form)
    names = [field["id"] for field in form["body"]]
    assert len(set(names)) == len(names) and all(field["attributes"]["label"] for field in form["body"])
    assert {field["type"] for field in form["body"]} <= {"textarea", "input", "dropdown", "markdown", "checkboxes"}


def test_there_are_forms_for_bug_question_and_feature() -> None:
    assert {p.stem for p in FORMS} == {"bug", "question", "feature"}
    bug = yaml.safe_load((GITHUB / "ISSUE_TEMPLATE" / "bug.yml").read_text())
    asked = next(f for f in bug["body"] if f["id"] == "doctor")
    assert "gtmodel doctor" in asked["attributes"]["label"] and asked["validations"]["required"]


def test_the_forge_runs_make_test_on_every_python_that_is_supported() -> None:
    workflow = read_yaml(".github/workflows/test.yml")
    jobs = workflow["jobs"]
    assert jobs["test"]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13", "3.14"]
    least = tomllib.loads((CLONE / "pyproject.toml").read_text())["project"]["requires-python"]
    assert least == ">=" + jobs["test"]["strategy"]["matrix"]["python"][0]
    commands = [s["run"] for job in jobs.values() for s in job["steps"] if "run" in s]
    assert any(c.startswith("make test ") for c in commands) and any(c.startswith("make docs ") for c in commands)
    named = {target for c in commands for target in re.findall(r"^make ([a-z]+)", c)}
    assert named <= targets()
    # only main is published
    assert workflow["permissions"] == {"contents": "read"} and "refs/heads/main" in jobs["publish"]["if"]
    assert jobs["publish"]["needs"] == ["test", "site"]


def test_a_release_is_a_draft_of_the_archives_that_were_tried() -> None:
    """The workflow runs the script that a person runs, and no release is made where it fails or the tag is another."""
    workflow = read_yaml(".github/workflows/release.yml")
    dist, release = workflow["jobs"]["dist"], workflow["jobs"]["release"]
    commands = [s["run"] for s in dist["steps"] if "run" in s]
    assert commands[-1].startswith("make dist ") and "pyproject.toml" in commands[0]
    (recipe,) = re.findall(r"^dist:.*\n\t(\S+)", (CLONE / "Makefile").read_text(), re.MULTILINE)
    assert os.access(CLONE / recipe, os.X_OK)
    assert release["needs"] == "dist" and "--draft" in release["steps"][-1]["run"]
    assert workflow["permissions"] == {"contents": "read"} and release["permissions"] == {"contents": "write"}


def test_the_site_is_published_from_where_it_is_built() -> None:
    site = read_yaml(".github/workflows/test.yml")["jobs"]["site"]["steps"]
    (upload,) = [step for step in site if "upload-pages-artifact" in step.get("uses", "")]
    assert upload["with"]["path"] in (CLONE / "Makefile").read_text()


def test_pre_commit_checks_style_as_make_test_does() -> None:
    (repository,) = read_yaml(".pre-commit-config.yaml")["repos"]
    assert repository["repo"] == "local"  # so that ruff is the one of constraints.txt
    entries = [hook["entry"].removeprefix(".venv/bin/") for hook in repository["hooks"]]
    recipe = (CLONE / "Makefile").read_text()
    assert entries == ["ruff check .", "ruff format --check ."]
    assert all(f"$(BIN)/{entry}\n" in recipe for entry in entries)


@pytest.mark.parametrize("name", PAGES)
def test_pages_name_commands_and_files_that_are_there(name: str) -> None:
    text = (CLONE / name).read_text(encoding="utf-8")
    make = set(re.findall(r"`make ([a-z]+)", text))
    assert make <= targets(), make - targets()
    for path in re.findall(r"`([a-z]\w*/[\w./]*)`", text):
        assert "NAME" in path or any((root / path).exists() for root in (CLONE, CLONE / "gtmodel")), path
    for test in re.findall(r"`(test_\w+\.py)`", text):
        assert (CLONE / "tests" / test).is_file(), test


@pytest.mark.parametrize("name", [*PAGES, "CITATION.cff", *WORKFLOWS, ".pre-commit-config.yaml"])
def test_no_page_names_a_machine_or_an_address_of_a_person(name: str) -> None:
    text = (CLONE / name).read_text(encoding="utf-8")
    assert not re.search(r"/home/|/root/|/Users/|\w@[\w-]+\.\w", text)
