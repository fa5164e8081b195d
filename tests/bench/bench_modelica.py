"""Time and memory to read Modelica text: parsing with a cached grammar, flattening, rejecting invalid text.

Also how much faster a model of library components is read the second time, when the trees of the library's files are
kept: components of a library that is written here, and of the Modelica Standard Library where MODELICAPATH names it.

Prints Markdown. Processor time, the least of several runs; memory by tracemalloc. Exit code 1 where a bound is passed.
"""

from __future__ import annotations

import gc
import os
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from gtmodel.lang import ModelError
from gtmodel.modelica.names import libraries
from gtmodel.modelica.reader import parse
from gtmodel.modelica.translate import translated

# issue 28
PARSED, FLATTENED, REFUSED_MB = 0.150, 5.0, 64.0
LINES, COMPONENTS = 259, 300
FASTER = 5.0  # the second time; of 2 s for parsing a library then 0.4 s are left
EXAMPLES = Path(__file__).resolve().parents[2] / "problems" / "models" / "library_examples.mo"

RING = """package Ring
  connector Flange Real s; flow Real f; end Flange;
  model Mass
    parameter Real m = 1;
    Flange a; Flange b;
    Real v(start = 0, fixed = true);
    Real s(start = 0, fixed = true);
  equation
    a.s = s; b.s = s; der(s) = v; m*der(v) = a.f + b.f;
  end Mass;
  model Spring
    parameter Real c = 10;
    Flange a; Flange b;
  equation
    a.f = c*(a.s - b.s); a.f + b.f = 0;
  end Spring;
  model Chain
    parameter Integer n = 150;
    Mass mass[n](m = 1:n);
    Spring spring[n](each c = 20);
  equation
    for i in 1:n loop
      connect(spring[i].b, mass[i].a);
    end for;
    for i in 1:n - 1 loop
      connect(mass[i].b, spring[i + 1].a);
    end for;
  end Chain;
end Ring;
"""


def least(work: Callable[[], Any], times: int) -> float:
    """Processor time [s] of the fastest run."""
    taken = []
    for _ in range(times):
        begin = time.process_time()
        work()
        taken.append(time.process_time() - begin)
    return min(taken)


def of_lines(count: int) -> str:
    """A model of that many lines."""
    body = [f'  Real x{k}(start = {k}, fixed = true) "state {k}";' for k in range((count - 3) // 2)]
    body += ["equation"] + [f"  der(x{k}) = -x{k}^2*sin(time) + {k}*exp(-x{k});" for k in range((count - 3) // 2)]
    return "\n".join(["model Lines", *body, "end Lines;"])


def refused() -> float:
    """Memory [MB] that refusing 10 MB of brackets takes beyond the text itself."""
    text = "(" * 10_000_000
    tracemalloc.start()
    try:
        parse(text)
        raise AssertionError("10 MB of brackets were accepted")
    except ModelError:
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def first_and_again(reference: str, library: list[str]) -> tuple[float, float]:
    """Processor times [s] to read a class: with an empty cache, and the least of three runs with the cache filled."""
    gc.collect()
    before = os.environ.get("GTMODEL_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GTMODEL_CACHE"] = folder
        try:
            first = least(lambda: translated(reference, library=library), 1)
            return first, least(lambda: translated(reference, library=library), 3)
        finally:
            os.environ.pop("GTMODEL_CACHE")
            if before is not None:
                os.environ["GTMODEL_CACHE"] = before


def many_classes(folder: Path) -> tuple[str, list[str]]:
    """A class that uses two classes of a library of 400, and that library."""
    package = folder / "Many"
    package.mkdir()
    for part in range(4):
        classes = [
            f"""  model M{k} "of many"
    parameter Real k(min = 0, unit = "1") = {k} "a number" annotation(Dialog(group = "numbers"));
    Real x(start = k, fixed = true);
  equation
    der(x) = -k*x^2*sin(time) + exp(-x)/(1 + {k}*x^2);
  end M{k};"""
            for k in range(100)
        ]
        text = "\n".join(["within Many;", f"package P{part}", *classes, f"end P{part};"])
        (package / f"P{part}.mo").write_text(text)
    (package / "package.mo").write_text("package Many end Many;")
    (folder / "m.mo").write_text("model M Many.P1.M7 a; Many.P3.M9 b(k = 2); end M;")
    return f"{folder / 'm.mo'}:M", [str(package)]


def of_libraries() -> list[tuple[str, float, float]]:
    """Names, and processor times of a first and a later read."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [("two of 400 classes in files of 100", *first_and_again(*many_classes(Path(folder))))]
    if folders := libraries():
        for name in ("LowPass", "Drive", "Oscillator", "ControlLoop"):
            rows.append((f"{name} of library_examples.mo", *first_and_again(f"{EXAMPLES}:{name}", folders)))
    return rows


def main() -> int:
    text = of_lines(LINES)
    parse(text)  # the tables of the grammar are made, or read from the cache
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "ring.mo"
        file.write_text(RING)
        flat = least(lambda: translated(f"{file}:Chain"), 1)
    rows = [
        (f"parse {len(text.splitlines())} lines", least(lambda: parse(text), 5), PARSED, "s"),
        (f"flatten {COMPONENTS} components, to a class", flat, FLATTENED, "s"),
        ("memory to reject 10 MB of brackets", refused(), REFUSED_MB, "MB"),
    ]
    print("| operation | measured | limit |\n|---|---|---|")
    for operation, measured, bound, unit in rows:
        print(f"| {operation} | {measured:.3g} {unit} | {bound:g} {unit} |")
    again = of_libraries()
    print("\n| class of a library | first read | from cache | speed-up | at least |\n|---|---|---|---|---|")
    for name, first, later in again:
        print(f"| {name} | {first:.3g} s | {later:.3g} s | {first / later:.1f} | {FASTER:g} |")
    slow = any(first < FASTER * later for _, first, later in again)
    return int(slow or any(measured > bound for _, measured, bound, _ in rows))


if __name__ == "__main__":
    sys.exit(main())
