"""Draw the pictures of the README anew, into docs/pictures: python docs/make_pictures.py"""

from __future__ import annotations

from pathlib import Path

import gtmodel as gt

PICTURES = {
    "l1_min_time": ("l1_min_time", "motion"),
    "l1_compliance": ("compliance_l1", "softest"),
    "hexapod": ("calibrate_hexapod", "pose_errors"),
}
"""Name -> problem and figure."""
WIDTH = 1200  # pixels


def main() -> None:
    """Solve each problem and keep one of its figures."""
    folder = Path(__file__).parent / "pictures"
    folder.mkdir(exist_ok=True)
    for name, (problem, figure) in PICTURES.items():
        drawn = gt.load(problem)().figure(figure)
        # no date and no version: the same picture is the same bytes
        drawn.savefig(folder / f"{name}.png", dpi=WIDTH / drawn.get_figwidth(), metadata={"Software": None})


if __name__ == "__main__":
    main()
