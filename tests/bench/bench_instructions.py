"""Generated C beside closed forms by hand (tests/oracle/three_link.c and arms.c): instructions per call at gcc -O2.

Prints Markdown; ends with 1 if a generated body costs more than RATIO times its peer, or the peer more than its
limit. Without valgrind it says so and measures nothing.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.bench.arm_pairs import PEER as ARMS, arm_pairs
from tests.bench.callgrind import FLAGS, body_call, count, generate, guarded_call, missing
from tests.bench.three_link_pairs import LIMITS, LINK_MASSES, PEER, POINTS, RATIO, Pairs, three_link_pairs


def table(links: str) -> tuple[list[str], bool]:
    """Lines of the table for one robot, or for two arms ("arms"), and whether all is within the limits."""
    pairs = three_link_pairs(links) if links != "arms" else Pairs(arm_pairs(), "")
    peer = PEER if links != "arms" else ARMS
    calls = {f"hand {p.key}": p.peer for p in pairs.all}
    calls |= {f"body {p.key}": body_call(p.key, p.function, p.peer.points) for p in pairs.all}
    calls |= {f"guarded {p.key}": guarded_call(p.key, p.function, p.peer.points) for p in pairs.all}
    with tempfile.TemporaryDirectory() as folder:
        sources = generate({p.key: p.function for p in pairs.all}, Path(folder) / "generated")
        counts = count(calls, [*sources, peer], pairs.parameters)
    what = links if links == "arms" else f"L1 with {links}"
    lines = [
        f"| {what} | by hand | at most | generated | ratio | | with guards |",
        "|---|---:|---:|---:|---:|---|---:|",
    ]
    good = True
    for p in pairs.all:
        hand, body, guarded = (counts[f"{what} {p.key}"].instructions for what in ("hand", "body", "guarded"))
        passed = body <= RATIO * hand and hand <= LIMITS.get(p.key, hand)
        good &= passed
        lines.append(
            f"| {p.title} | {hand:.0f} | {LIMITS.get(p.key, '')} | {body:.0f} | {body / hand:.2f} | "
            f"{'pass' if passed else 'FAIL'} | {guarded:.0f} |"
        )
    return lines, good


def main() -> int:
    lacking = missing()
    if lacking:
        print(f"Instructions: {lacking}.")
        return 0
    print(f"Instructions per call by callgrind, gcc {' '.join(FLAGS)}, mean of {POINTS} poses.")
    print(f"Parameters are folded in (generated) or inputs (by hand); pass: generated at most {RATIO} times by hand.")
    good = True
    for links in (*LINK_MASSES, "arms"):
        lines, passed = table(links)
        good &= passed
        print("\n" + "\n".join(lines))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
