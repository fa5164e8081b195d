"""Values of variables of a text without states."""

from __future__ import annotations

from pathlib import Path

import gtmodel as gt


def values(tmp_path: Path, text: str, *names: str, name: str = "M") -> list[float]:
    """Variables of a model without states."""
    file = tmp_path / "text.mo"
    file.write_text(text)
    model = gt.modelica.load(f"{file}:{name}")()
    *numbers, status = model.causal(targets=list(names))()
    assert status.ok
    return [float(x) for x in numbers]


def one(tmp_path: Path, expression: str, before: str = "", around: str = "") -> float:
    text = f"{around}\nmodel M\n{before}\n  Real result;\nequation\n  result = {expression};\nend M;\n"
    return values(tmp_path, text, "result")[0]
