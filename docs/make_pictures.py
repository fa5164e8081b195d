"""Draw the pictures of the README and of the pages on arms anew, into docs/pictures: python docs/make_pictures.py"""

from __future__ import annotations

import tempfile
from pathlib import Path

import gtmodel as gt

PICTURES = {
    "l1_min_time": ("l1_min_time", "motion"),
    "l1_compliance": ("compliance_l1", "softest"),
    "hexapod": ("calibrate_hexapod", "pose_errors"),
}
"""Name -> problem and figure."""


def main() -> None:
    """Solve each problem and keep one of its figures."""
    folder = Path(__file__).parent / "pictures"
    folder.mkdir(exist_ok=True)
    for name, (problem, figure) in PICTURES.items():
        with tempfile.TemporaryDirectory() as written:
            gt.load(problem)().write(f"{written}/out", plot=True)
            (folder / f"{name}.png").write_bytes(Path(written, "out", f"{figure}.png").read_bytes())
    model, mesh = gt.load("arm_motion", "mesh.elements=20").arguments
    motion = gt.refine(model, mesh, tolerance=0.3).solution
    motion.plot("arm.q", "der(arm.q)", "arm.tau").savefig(folder / "arm_motion.png")


if __name__ == "__main__":
    main()
