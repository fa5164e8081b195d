"""What run.toml says of the machine: as Python's own modules say it, which start a process or read every package."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path

import pytest

from gtmodel.results import versions


def test_versions_are_those_of_the_installed_packages() -> None:
    stated = versions.versions()
    assert {name: stated[name] for name in versions._PACKAGES} == {name: version(name) for name in versions._PACKAGES}
    assert stated["platform"] == platform.platform()


@pytest.mark.parametrize("folders", [[], ["casadi-1.0.dist-info", "casadi-2.0.dist-info"]])
def test_an_unusual_installation_is_asked_of_importlib(
    folders: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in folders:
        (tmp_path / folder).mkdir()
    package = tmp_path / "casadi" / "__init__.py"
    monkeypatch.setattr(versions, "find_spec", lambda _: type("Spec", (), {"origin": str(package)}))
    assert versions._installed("casadi") == version("casadi")


def test_a_package_that_is_not_there_is_said_to_be_not_found() -> None:
    assert versions._installed("no_such_package") == "not found"
