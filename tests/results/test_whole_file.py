"""Single files: a write that breaks off leaves the earlier one, and nobody's file is replaced unasked."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.results import ArgumentError
from tests.support.keeping_compiler import keeping_compiler
from tests.support.own_models import FILES

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size on Windows")


@contextmanager
def no_file_beyond(size: int) -> Iterator[None]:
    """As a quota does, or a disk that is full from there on."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture(scope="module", autouse=True)
def compiled_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if cc := keeping_compiler(tmp_path_factory.mktemp("compiler")):
            patch.setenv("CC", cc)
        yield


def bundle() -> gt.vision.BundleFile:
    lens = np.array([[1.0, 0, 0, 0, 0, 0, -5, 400, 0.01, 0]])
    return gt.vision.BundleFile(lens, np.array([[0.1, 0.2, 0.3]]), np.array([0]), np.array([0]), np.array([[8.5, 1.0]]))


def pictures(place: Path, **more: bool) -> None:
    V = gt.vision.robot_cameras
    seen = V.made_pictures(V.SyntheticRobotCameras(counts=[3, 3, 3])).pictures
    V.write_pictures(seen, place, place.with_name("carts.csv"), **more)


@pytest.mark.parametrize(("size", "sentence"), [(40_000, "cannot be written"), (10_000, "temporary folder")])
def test_a_unit_whose_writing_breaks_off_locks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int, sentence: str
) -> None:
    (tmp_path / "own_pendulum.py").write_text(FILES["pendulum.py"])
    monkeypatch.syspath_prepend(str(tmp_path))
    from own_pendulum import Pendulum  # type: ignore[import-not-found]

    place = tmp_path / "pendulum.fmu"
    gt.fmu.export(Pendulum(), place, known="phi", targets="tau")
    before = place.read_bytes()
    with no_file_beyond(size), pytest.raises(ArgumentError, match=sentence):
        gt.fmu.export(Pendulum(), place, known="phi", targets="tau", title="another")
    assert place.read_bytes() == before and not list(tmp_path.glob(".*.part"))
    gt.fmu.export(Pendulum(), place, known="phi", targets="tau", title="another")
    assert place.read_bytes() != before


@pytest.mark.parametrize(
    "writing", [lambda place, **more: gt.vision.write_bal(place, bundle(), **more), pictures], ids=["bal", "pictures"]
)
def test_a_persons_file_stays(tmp_path: Path, writing: Callable[..., None]) -> None:
    place = tmp_path / "mine.csv"
    place.write_text("mine")
    with pytest.raises(FileExistsError, match="was not changed"):
        writing(place)
    assert place.read_text() == "mine"
    writing(place, overwrite=True)
    assert place.read_text() != "mine"
