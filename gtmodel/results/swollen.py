"""How much larger than its file the data in it may be: a compressed or damaged file may declare any size."""

from __future__ import annotations

from pathlib import Path

from .whole_file import PathLike

GROWTH, SMALL = 200.0, 1 << 28  # how many times larger than the file numbers may be; bytes that always may


def swollen(path: PathLike, size: float, most_growth: float = GROWTH) -> str:
    """What is said of data of so many bytes in this file, "" where it may hold them."""
    own = Path(path).stat().st_size
    if size <= max(SMALL, most_growth * own):
        return ""
    times = size / max(own, 1)
    most = f"expected at most {most_growth:g} times"
    return f"would take {size / 1e6:.4g} MB, {times:.3g} times the size of the file; {most}"
