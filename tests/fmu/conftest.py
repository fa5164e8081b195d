"""Units that several tests use, each made once."""

from __future__ import annotations

from functools import cache

import pytest

import gtmodel as gt
from gtmodel.compiler.toolchain import find
from tests.fmu.makers import MAKERS
from tests.fmu.raw import unpacked

if isinstance(find(), str):
    collect_ignore_glob = ["test_*.py"]  # no C compiler: no unit


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
