"""What a problem file asks for, as the report of its result shows it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.from_options import Key, keys_of
from gtmodel.problem_files.load import Loaded
from gtmodel.problem_files.registry import names
from gtmodel.problem_files.run import leaves
from gtmodel.results import Study
from gtmodel.results.disk import write_whole
from gtmodel.results.page.page import Asked, page, written_here
from gtmodel.results.quantity import unit_of
from gtmodel.results.written import sha256, sha256_of_file

HELP = "##"  # comments of gtmodel new
NO_REMARK = re.compile(rf"#:schema|{HELP}|# (gtmodel \w+ \S+|problems/\S+)\.toml")
FLOAT = re.compile(r"-?\d+\.\d+(e[+-]?\d+)?")
_HEAD = {"kind", "title"}


def refuse_another(file: Path, option: str) -> None:
    """Raises InputError if a file is there that is no page, picture or film of gtmodel."""
    if file.exists() and not written_here(file):
        raise InputError(f"{option} {file} is there already and gtmodel did not write it; name another file")


def write(file: Path, study: Study, about: Asked) -> Path:
    """Write the report of a study into a file of its own, and return its path. Raises InputError."""
    refuse_another(file, "--report")
    try:
        write_whole(file, page(study, about).encode(), overwrite=True)
    except OSError as error:
        raise InputError(f"--report {file} cannot be written: {error.strerror}") from error
    return file


def asked(loaded: Loaded, context: Context, options: Sequence[str] = (), command: str = "solve") -> Asked:
    """Return what the report says about a problem.

    options: further ones of the command, such as --write-failed; those of solve are followed by --report and --out.
    """
    problem = loaded.problem
    whole = dict(leaves(problem.model_dump(mode="json", exclude_none=True, exclude=_HEAD)))
    chosen = dict(leaves(problem.model_dump(mode="json", exclude_none=True, exclude=_HEAD, exclude_unset=True)))
    known = {key.key: key for key in keys_of(type(problem))}
    files = [(name, path.name, sha256_of_file(path)) for name, path in context.inputs.items()]
    words = ["gtmodel", command, loaded.path.name]
    words += [word for setting in loaded.settings for word in ("--set", setting)]
    words += [] if context.max_seconds is None else ["--max-seconds", f"{context.max_seconds:g}"]
    words += ["--start", context.inputs["start"].name] if "start" in context.inputs else []
    last = ("--report", "--out", f"{context.name}-result")
    return Asked(
        title=problem.heading,
        what=f"{problem.kind}: {names()[problem.kind]}.",
        keys=list(_rows(chosen, known)),
        defaults=list(_rows({k: v for k, v in whole.items() if k not in chosen}, known)),
        inputs=[("problem", loaded.path.name, sha256(loaded.content)), *files],
        command=shlex.join([*words, *options, *(last if command == "solve" else ())]),
        remarks=_remarks(loaded.content),
    )


def _rows(values: Mapping[str, str], known: Mapping[str, Key]) -> Iterator[tuple[str, str, str, str]]:
    for key, value in values.items():
        about = declared(key, known)
        unit = about.unit if about and about.unit else unit_of(key.rpartition(".")[2])
        # a float as written by hand: 2.5e+07 or 0.1, not 25000000.0
        shown = value if '"' in value else FLOAT.sub(lambda x: f"{float(x[0]):.10g}", value)
        # tables in a list are declared by their keys
        yield key, shown, unit, about.description if about else "none of these tables" if value == "[]" else ""


def declared(key: str, known: Mapping[str, Key]) -> Key | None:
    """The declaration of a key of a file, such as box[2].low_m, signals.force.unit, declared as signals.*.unit, or
    parameters.m_p, one value of the table parameters."""
    path, plain = (re.sub(r"\[\d*\]", brackets, key) for brackets in ("[]", ""))
    for name in (path, plain):
        if name in known:
            return known[name]
    for name, about in known.items():
        if "*" in name and re.fullmatch(re.escape(name).replace(r"\*", r"[^.]+"), plain):
            return about
    table = path.rpartition(".")[0]
    return declared(table, known) if table else None


def _remarks(content: bytes) -> list[str]:
    """Comments of the problem file that stand on lines of their own: what its author says about it."""
    lines = content.decode("utf-8-sig").splitlines()
    own = [s.startswith("#") and not NO_REMARK.match(s) for s in lines]
    remarks = [s[1:].strip() if kept else "" for s, kept in zip(lines, own, strict=True)]
    return [" ".join(block.split()) for block in re.split(r"\n\s*\n", "\n".join(remarks)) if block.strip()]
