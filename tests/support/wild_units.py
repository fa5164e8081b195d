"""A synthetic unit of another maker, compiled here, that misbehaves as its parameters say; see wild_unit.c."""

from __future__ import annotations

import io
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).with_name("wild_unit.c")
How = IntEnum(
    "How",
    "ABORTS EXITS CRASHES HANGS PRINTS ASKS_TO_END WANTS_EVENT ELSEWHERE NO_NUMBER DISCARDS SCRIBBLES STAYS",
)
COMMANDS, POSITIONS = [[f"{name}[{k}]" for k in (1, 2, 3)] for name in ("command", "position")]
_NAMES = [("how", "parameter"), ("code", "parameter"), ("when", "parameter")]
_NAMES += [*[(c, "input") for c in COMMANDS], *[(p, "output") for p in POSITIONS]]
_OUTPUTS = range(len(_NAMES) - 3, len(_NAMES))
_FOLDERS = {2: "linux64", 3: "x86_64-linux"}


def starts(how: How, *, code: float = 0.0, when: float = 0.004, carts: Sequence[float] = (0.0, 0.0, 0.0)):
    """Start values by name: what it does, with which code or time, in the step that begins at `when` [s], at 0 on the
    way out of initialization; and where its carts are [m]."""
    at = dict(zip(POSITIONS + COMMANDS, [*carts, *carts], strict=True))
    return {"how": float(how), "code": code, "when": when} | at


@cache
def wild(version: int) -> bytes:
    """The archive."""
    with tempfile.TemporaryDirectory() as place:
        library = Path(place) / "wild.so"
        command = ["gcc", "-O1", "-shared", "-fPIC", f"-DVERSION={version}", str(SOURCE), "-o", str(library)]
        subprocess.run(command, check=True)
        return packed({"modelDescription.xml": described(version), f"binaries/{_FOLDERS[version]}/wild.so":
                       library.read_bytes()})  # fmt: skip


def packed(files: dict[str, bytes]) -> bytes:
    """A zip of files by their names."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return made.getvalue()


def described(version: int) -> bytes:
    """modelDescription.xml."""
    exact = {"parameter": "", "input": "", "output": ' initial="exact"'}
    kinds = {"parameter": "fixed", "input": "continuous", "output": "continuous"}
    variables, outputs = [], []
    for k, (name, causality) in enumerate(_NAMES):
        unit = ' unit="m"' if causality != "parameter" else ""
        start = -1.0 if name == "when" else 0.0
        more = f'causality="{causality}" variability="{kinds[causality]}"{exact[causality]}'
        if version == 2:
            variables.append(f'<ScalarVariable name="{name}" valueReference="{k}" {more}><Real{unit} start="{start}"/>'
                             "</ScalarVariable>")  # fmt: skip
        else:
            variables.append(f'<Float64 name="{name}" valueReference="{k}" {more}{unit} start="{start}"/>')
    if version == 3:
        time = f'<Float64 name="time" valueReference="{len(_NAMES)}" causality="independent" variability="continuous"/>'
        variables.append(time)
    for k in _OUTPUTS:
        outputs.append(f'<Unknown index="{k + 1}"/>' if version == 2 else f'<Output valueReference="{k}"/>')
    token = "guid" if version == 2 else "instantiationToken"
    structure = f"<Outputs>{''.join(outputs)}</Outputs>" if version == 2 else "".join(outputs)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{version}.0" modelName="wild" '
        f'{token}="{{1}}"><CoSimulation modelIdentifier="wild"/>'
        '<UnitDefinitions><Unit name="m"><BaseUnit m="1"/></Unit>'
        f"</UnitDefinitions><ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    ).encode()
