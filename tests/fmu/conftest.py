"""Units that several tests use, each made once."""

from __future__ import annotations

from functools import cache
from importlib import import_module

import pytest

import gtmodel as gt
from gtmodel.compiler.toolchain import find
from gtmodel.fmu.export import FLAGS
from tests.fmu.makers import MAKERS
from tests.fmu.raw import unpacked

if isinstance(find(), str):
    collect_ignore_glob = ["test_*.py"]  # no C compiler: no unit


@pytest.fixture(scope="session", autouse=True)
def compiled_once():
    """The same sources give the same library, so it is made once, and without optimisation in half of the time: it
    computes the same bits. That two compilations give the same bytes is seen in processes of their own, which this does
    not reach."""
    export = import_module("gtmodel.fmu.export")  # the package has a function of that name
    real, made = export._compiled, {}

    def compile_once(compiler, files, link):
        if link != export.LINK:  # for Windows
            return real(compiler, files, link)
        key = (compiler, export.FLAGS, *files.items())
        if key not in made:
            made[key] = real(compiler, files, link)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "_compiled", compile_once)
        patch.setattr(export, "FLAGS", tuple(f for f in export.FLAGS if not f.startswith("-O")))
        yield


@pytest.fixture
def as_delivered(monkeypatch):
    """With the flags of a user's unit."""
    monkeypatch.setattr(import_module("gtmodel.fmu.export"), "FLAGS", FLAGS)


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """(name, version) -> unit and its library, unpacked."""

    @cache
    def make(name: str, version: int = 3):
        unit = MAKERS[name](version)
        place = tmp_path_factory.mktemp(f"{name}{version}")
        path = place / f"{name}.fmu"
        path.write_bytes(unit.data)
        return unit, unpacked(unit, place / "unpacked"), path

    return make


@pytest.fixture(scope="session")
def robot():
    return gt.robots.gantry_tau("l1_tape")
