"""Recordings between which the device was moved, and a payload under which the tool sags, by the study."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtmodel.calibrate import Sag
from gtmodel.results import ArgumentError
from tests.calibrate.shipped import data, measured, solved

MOVED = (np.array([120.0, -300.0, 40.0]), Rotation.from_rotvec([0.05, -0.1, 0.7]))  # mm
K = 3e-6  # m/N
FRAME = 1.5e-3  # rad or m: carts 0.2 mm off their lines, which two halves of the room see differently
MASS = 20.0  # kg, at every other pair of poses


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped synthetic L1 (seed 1): the second hundred seen from elsewhere; the tool 0.59 mm lower under 20 kg."""
    at = tmp_path_factory.mktemp("sessions")
    head, cells = data("l1")
    moved, sunk = [], []
    for n, row in enumerate(cells):
        T = np.array(row[3:6], float)
        first = n < 100
        seen = T if first else MOVED[1].inv().apply(T - MOVED[0])
        moved.append(",".join([*row[:3], *(f"{x:.4f}" for x in seen), "first" if first else "second"]))
        load = MASS if n // 2 % 2 else 0.0
        lower = T - [0.0, 0.0, 1e3 * K * 9.81 * load]
        sunk.append(",".join([*row[:3], *(f"{x:.4f}" for x in lower), f"{load:g}"]))
    (at / "moved.csv").write_text("\n".join([*head[:-1], f"{head[-1]},session", *moved]) + "\n")
    (at / "sunk.csv").write_text("\n".join([*head[:-1], f"{head[-1]},payload", *sunk]) + "\n")
    return at


EACH = {"frame": "device", "session": "session", "device_per_session": True}


def test_two_set_ups_of_the_device_are_calibrated_together(folder: Path) -> None:
    fixed = {"fixed": ["A[2]", "v[2,1]", "v[2,2]", "A[1,0]"]}  # one frame is a choice of coordinates
    v = solved("l1", folder / "moved.csv", how=measured("l1", **EACH), **fixed).values
    assert v["held_out_mm"]["mean"] < 0.3  # 0.18 mm in one frame
    m = v["measurement"]
    t, u = (
        [np.array([m[f"T.device.{part} in {s}[{k}]"] for k in range(n)]) for s in ("first", "second")]
        for part, n in (("t", 3), ("u", 4))
    )
    first, second = (Rotation.from_quat(x, scalar_first=True) for x in u)
    between = first.inv() * second  # of the second set-up in the coordinates of the first: what was put in
    assert (between.inv() * MOVED[1]).magnitude() < FRAME
    np.testing.assert_allclose(first.inv().apply(t[1] - t[0]), MOVED[0] / 1e3, atol=FRAME)
    how = measured("l1", frame="device", session="session")
    one = solved("l1", folder / "moved.csv", how=how, held_out=0, **fixed)
    assert one.fitted is None or one.fitted["mean"] > 1e-3


def test_the_sag_is_estimated_given_or_said_to_be_unknown(folder: Path) -> None:
    def sunk(sag: Sag | None = None) -> dict:
        return dict(solved("l1", folder / "sunk.csv", how=measured("l1", sag=sag)).values)

    v = sunk(Sag("payload"))
    entry = next(u for u in v["unknowns"] if u["name"] == "T.sag")
    assert entry["unit"] == "m/N" and entry["value"] == pytest.approx(K, rel=0.05)
    given = sunk(Sag("payload", K))
    assert "T.sag" not in [u["name"] for u in given["unknowns"]] and given["measurement"]["T.sag"] == K
    without = sunk()
    assert given["held_out_mm"]["mean"] < 0.7 * without["held_out_mm"]["mean"]
    constant = sunk(Sag(10.0))
    assert constant["identifiability_after"]["redundant"] == 1
    assert any("T.sag" in s and "moves with" in s for s in constant["identifiability_after"]["notes"])


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ({"frame": "device", "device_per_session": True}, "name the column with the recording"),
        ({"sag": Sag("weight")}, "weight"),
        ({"sag": Sag(1.0, down=[0.0, 0.0, 0.0])}, "has no direction"),
    ],
)
def test_wrong_ways_to_read_get_a_sentence(folder: Path, how, sentence) -> None:
    with pytest.raises(ArgumentError, match=sentence):
        solved("l1", folder / "sunk.csv", how=measured("l1", **how))


def test_frames_of_sessions_that_are_held_out_are_refused(folder: Path) -> None:
    lines = (folder / "moved.csv").read_text().splitlines()
    (folder / "a.csv").write_text("\n".join(line for line in lines if not line.endswith("second")) + "\n")
    (folder / "b.csv").write_text("\n".join(line for line in lines if not line.endswith("first")) + "\n")
    with pytest.raises(ArgumentError, match="session 'second' are held out, so that the frame"):
        solved("l1", folder / "a.csv", how=measured("l1", **EACH), held_out=folder / "b.csv")
