"""Public URDF files in gtmodel and in pinocchio: kinematics and inverse dynamics of every chain, worst difference.

Files: those of the package example-robot-data (`pip install example-robot-data`), if it is installed, and of the folder
that $GTMODEL_URDFS names, such as a clone of github.com/Gepetto/example-robot-data. Without either it says so.
Prints Markdown; ends with status 1 where a difference is above 1e-10 of the largest value.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from pathlib import Path

import numpy as np

import gtmodel as gt
from gtmodel.robots.serial.described import MOVING
from gtmodel.robots.serial.from_urdf import _Chain, tips_of
from gtmodel.robots.serial.urdf_file import read_urdf
from tests.robots.arm_oracle import Pinocchio

AGREEMENT = 1e-10
POINTS, LONGEST = 5, 8  # motions of each chain; joints of a chain: hands and humanoids have longer ones
CHAINS = 2  # of each file, the ones with most joints


def files() -> list[Path]:
    """All URDF files that there are."""
    folders = [Path(os.environ["GTMODEL_URDFS"])] if os.environ.get("GTMODEL_URDFS") else []
    for name in ("example_robot_data", "example_robot_data_loaders"):
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.origin is not None:
            site = Path(spec.origin).resolve().parents[1]
            folders += [*site.glob("cmeel.prefix/share/example-robot-data"), *site.glob("example_robot_data")]
    return sorted({p.resolve() for folder in folders for p in folder.rglob("*.urdf")})


def compared(path: Path, tip: str) -> tuple[int, float, float]:
    """Joints of a chain, and the worst differences of place and turn, and of efforts over the largest."""
    arm = gt.robots.from_urdf(path, tip)
    urdf = read_urdf(path)
    chain, moving = _Chain(urdf, tip), {j.name for j in arm.structure.joints}
    coupled = {
        j.name: ("", 0.0, chain.stands(j)) for j in urdf.joints.values() if j.kind in MOVING and j.name not in moving
    }
    for j in arm.structure.joints:
        if j.leader is not None:
            coupled[j.name] = (arm.structure.joints[j.leader].name, j.multiplier, j.offset)
    oracle = Pinocchio(path, tip, coupled)
    n = len(arm.structure.leaders)
    function = arm.with_(viscous=np.zeros(len(moving)), coulomb=np.zeros(len(moving))).causal(
        known="q", targets=["T", "R", "tau"]
    )
    off, effort, largest = 0.0, 0.0, 1e-6
    for q, v, a in np.random.default_rng(1).uniform(-1.5, 1.5, (POINTS, 3, n)):
        T, R, tau, status = function(q, v, a)
        assert status is gt.Status.OK, status
        place, turn = oracle.tool(q)
        expected = oracle.efforts(q, v, a)
        off = max(off, float(np.abs(T - place).max()), float(np.abs(R - turn).max()))
        effort, largest = max(effort, float(np.abs(tau - expected).max())), max(largest, float(np.abs(expected).max()))
    return n, off, effort / largest


def main() -> int:
    """The table; 1 where something differs."""
    paths = files()
    if not paths:
        print("No public URDF: pip install example-robot-data, or name a folder of them in $GTMODEL_URDFS.")
        return 0
    print("| file | tip | joints | pose error | effort error | time [s] |\n|---|---|---|---|---|---|")
    worst, refused, seen = 0.0, 0, 0
    for path in paths:
        try:
            urdf = read_urdf(path)
        except gt.ModelError as error:
            refused += 1
            print(f"| {path.name} | rejected: {str(error).partition(': ')[2][:90]} | | | | |")
            continue
        lengths = {tip: len(_Chain(urdf, tip).moving) for tip in tips_of(urdf)}
        tips = sorted((t for t in lengths if 0 < lengths[t] <= LONGEST), key=lambda t: (-lengths[t], t))[:CHAINS]
        for tip in tips:
            begun = time.process_time()
            n, off, effort = compared(path, tip)
            seen += 1
            worst = max(worst, off, effort)
            print(
                f"| {path.name} | {tip} | {n} | {off:.1e} | {effort:.1e} | {time.process_time() - begun:.1f} |",
                flush=True,
            )
    print(f"\n{len(paths)} files, {refused} rejected, {seen} chains; worst difference {worst:.1e}")
    return int(worst > AGREEMENT)


if __name__ == "__main__":
    sys.exit(main())
