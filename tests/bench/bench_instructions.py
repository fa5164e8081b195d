"""Generated C beside closed forms by hand (tests/oracle/three_link.c and arms.c): instructions per call at gcc -O2.

The guarded function of the L1 also stands beside the code by hand with the parameters of the robot folded in by the
compiler, at equal flags and at -O3, where gcc computes two arms at a time. The code by hand checks nothing.

Prints Markdown; ends with 1 if a generated body costs more than RATIO times its peer, or the peer more than its
limit, or a guarded function more than FOLDED times folded code by hand at equal flags. Without valgrind it says so and
measures nothing.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

from tests.bench.arm_pairs import PEER as ARMS, arm_pairs
from tests.bench.callgrind import FLAGS, Call, body_call, count, generate, guarded_call, missing
from tests.bench.three_link_pairs import LIMITS, LINK_MASSES, PEER, POINTS, RATIO, Pair, Pairs, three_link_pairs

FOLDED = 1.0  # issue 46, for these functions of the L1 prototype, whose links are light
FOLDED_KEYS = ("fk", "ik", "velocity", "inverse_dynamics_tanh", "inverse_dynamics_linear")
FASTEST = tuple("-O3" if flag == "-O2" else flag for flag in FLAGS)


def folded(pairs: Pairs, folder: Path) -> tuple[Path, dict[str, Call]]:
    """A C file with the code by hand for this robot, and its calls by the keys of the pairs."""

    def call(p: Pair) -> Call:
        return Call(f"folded_{p.key}", f"folded_{p.key}(in, out);", p.peer.points, p.peer.outputs, "folded.h")

    heads = [f"void folded_{p.key}(const double *in, double *out)" for p in pairs.all]
    (folder / "folded.h").write_text("".join(f"{head};\n" for head in heads))
    # static, as the parameters: only then the compiler knows them
    own = re.sub(r"^void three_link_", "static void three_link_", PEER.read_text(), flags=re.M)
    own = own.replace(
        '#include "three_link.h"', re.sub(r"^void [^;]*;", "", PEER.with_suffix(".h").read_text(), flags=re.M)
    )
    bodies = [f"{head}\n{{\n    {p.peer.statement}\n}}\n" for head, p in zip(heads, pairs.all, strict=True)]
    (folder / "folded.c").write_text("\n".join(['#include "folded.h"', own, pairs.parameters, *bodies]))
    return folder / "folded.c", {p.key: call(p) for p in pairs.all}


def table(links: str) -> tuple[list[str], bool]:
    """Lines of the table for one robot, or for two arms ("arms"), and whether all is within the limits."""
    pairs = three_link_pairs(links) if links != "arms" else Pairs(arm_pairs(), "")
    peer = PEER if links != "arms" else ARMS
    calls = {f"hand {p.key}": p.peer for p in pairs.all}
    calls |= {f"body {p.key}": body_call(p.key, p.function, p.peer.points) for p in pairs.all}
    calls |= {f"guarded {p.key}": guarded_call(p.key, p.function, p.peer.points) for p in pairs.all}
    fastest = {}
    with tempfile.TemporaryDirectory() as folder:
        sources = generate({p.key: p.function for p in pairs.all}, Path(folder) / "generated")
        if links != "arms":
            source, own = folded(pairs, Path(folder))
            sources.append(source)
            calls |= {f"folded {key}": call for key, call in own.items()}
            fastest = count(own, [source], flags=FASTEST)
        counts = count(calls, [*sources, peer], pairs.parameters)
    what = links if links == "arms" else f"L1 with {links}"
    more = "" if links == "arms" else " folded by hand | ratio | | folded, -O3 | ratio |"
    lines = [
        f"| {what} | by hand | at most | generated | ratio | | with guards |{more}",
        f"|---|---:|---:|---:|---:|---|---:|{'---:|---:|---|---:|---:|' if more else ''}",
    ]
    good = True
    for p in pairs.all:
        hand, body, guarded = (counts[f"{what} {p.key}"].instructions for what in ("hand", "body", "guarded"))
        passed = body <= RATIO * hand and hand <= LIMITS.get(p.key, hand)
        good &= passed
        line = (
            f"| {p.title} | {hand:.0f} | {LIMITS.get(p.key, '')} | {body:.0f} | {body / hand:.2f} | "
            f"{'pass' if passed else 'FAIL'} | {guarded:.0f} |"
        )
        if fastest:
            equal, most = counts[f"folded {p.key}"].instructions, fastest[p.key].instructions
            verdict = (
                ("pass" if guarded <= FOLDED * equal else "FAIL")
                if p.key in FOLDED_KEYS and not any(LINK_MASSES[links])
                else ""
            )
            good &= verdict != "FAIL"
            line += f" {equal:.0f} | {guarded / equal:.2f} | {verdict} | {most:.0f} | {guarded / most:.2f} |"
        lines.append(line)
    return lines, good


def main() -> int:
    lacking = missing()
    if lacking:
        print(f"Instructions: {lacking}.")
        return 0
    print(f"Instructions per call by callgrind, gcc {' '.join(FLAGS)}, mean of {POINTS} poses.")
    print(f"Parameters are folded in (generated) or inputs (by hand); pass: generated at most {RATIO} times by hand,")
    print(f"and with guards at most {FOLDED} times by hand with the parameters folded in.")
    good = True
    for links in (*LINK_MASSES, "arms"):
        lines, passed = table(links)
        good &= passed
        print("\n" + "\n".join(lines))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
