"""The command ``gtmodel``.

Exit code 0: solved and every check passed; 1: failed; 2: bad input, with one sentence on stderr.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any

# no windows; set before anything imports matplotlib
os.environ.setdefault("MPLBACKEND", "Agg")
# pydantic searches every installed package for plugins; our schemas need none
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")

import typer
from typer.exceptions import TyperException
from typer.main import get_command

from gtmodel import _terminal as terminal
from gtmodel._answer import answering, refused

app = typer.Typer(
    help="Kinematics, dynamics, optimal motions and C code of robots, from one set of equations.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _problems(prefix: str) -> list[str]:
    """Shell completions of a problem: TOML files here, and the shipped names."""
    from gtmodel.problem_files.files import shipped_names

    here = sorted(str(path) for path in Path().glob(f"{prefix}*.toml"))
    return here + [name for name in shipped_names() if name.startswith(prefix)]


def _kinds(prefix: str) -> list[str]:
    from gtmodel.problem_files import names

    return [name for name in names() if name.startswith(prefix)]


def _folder(path: Path | None) -> Path | None:
    """Refuse an option in place of a folder: the folder was probably forgotten."""
    if path is not None and str(path).startswith("-"):
        raise typer.BadParameter(f"expected a folder, found '{path}'; write ./{path} for a folder of that name")
    return path


Json = Annotated[bool, typer.Option("--json", help="Print exactly one JSON object on stdout.")]
Problem = Annotated[
    str,
    typer.Argument(
        metavar="PROBLEM.toml", help="Problem file, or the name of a shipped problem.", autocompletion=_problems
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change a key of the file: limits.force_N=500; repeatable."),
]
Out = Annotated[Path | None, typer.Option(metavar="DIR", help="Write the result into this folder.", callback=_folder)]
Report = Annotated[
    bool, typer.Option("--report", help="Write report.html, one page to send; into ./NAME-result without --out.")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress on stderr.")]
WriteFailed = Annotated[
    bool,
    typer.Option("--write-failed", help="Write machine files even if a check failed, marked in the first line."),
]
Workers = Annotated[
    int | None,
    typer.Option(metavar="N", help="Processes for independent rows, such as starts or samples; 0 for this one."),
]
Cluster = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://host:8786; or set GTMODEL_CLUSTER.")
]


def _version(requested: bool) -> None:
    if requested:
        from gtmodel._version import __version__

        print(f"gtmodel {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_version, help="Print the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    context.obj = debug


@app.command("list")
def list_(
    context: typer.Context,
    what: Annotated[str, typer.Argument(metavar="[robots|problems|FILE.mop]")] = "all",
    as_json: Json = False,
) -> None:
    """Show the robots of the catalogue and the problems shipped with gtmodel, or the classes of a Modelica file."""
    from gtmodel.problem_files import files

    with answering(context, as_json, what) as answer:
        entries_by_word = answer.data = files.of(what)
    for n, (name, entries) in enumerate(entries_by_word.items() if not as_json else ()):
        if n:
            print()
        head = ("class" if name == "classes" else name.removesuffix("s"), *files.HEADS[name])
        terminal.table(head, [(key, *map(str, texts.values())) for key, texts in entries.items()])


@app.command()
def explain(
    context: typer.Context,
    what: Annotated[
        str, typer.Argument(metavar="ROBOT|PROBLEM.toml", help="Robot, as after robot = in a problem file, or problem.")
    ],
    known: Annotated[list[str] | None, typer.Option(help="Prescribed variables, separated by commas.")] = None,
    targets: Annotated[list[str] | None, typer.Option(help="Variables to compute.")] = None,
    prefer: Annotated[list[str] | None, typer.Option(help="Variables to keep as states.")] = None,
    settings: Set = None,
    full: Annotated[bool, typer.Option("--full", help="List every block of equations with its source line.")] = False,
    mobility: Annotated[
        bool, typer.Option("--mobility", help="Show degrees of freedom, redundant constraints and idle motions.")
    ] = False,
    python: Annotated[bool, typer.Option("--python", help="Print a Modelica class in Python.")] = False,
    flat: Annotated[bool, typer.Option("--flat", help="Print a Modelica class flattened, without components.")] = False,
) -> None:
    """Show how a robot's variables follow from the known ones, or what a problem computes.

    If the robot or the problem names a Python file, the command runs that file.
    """
    from gtmodel.problem_files import explaining
    from gtmodel.problem_files.load import refuse_twice

    with answering(context, False, what):
        refuse_twice(settings or ())
        options = (known or (), targets or (), prefer or (), settings or ())
        if mobility:
            text = explaining.mobility_of(what, *options)
        else:
            text = (
                explaining.printed(what, flat, *options) if python or flat else explaining.of(what, *options, full=full)
            )
    print(text)


@app.command()
def schema(
    context: typer.Context,
    kind: Annotated[
        str | None, typer.Argument(metavar="KIND", help="Lists the kinds if left out.", autocompletion=_kinds)
    ] = None,
    as_json: Json = False,
    for_editors: Annotated[
        bool, typer.Option("--json-schema", help="Print the JSON Schema with which editors complete and check keys.")
    ] = False,
) -> None:
    """Show the keys of a kind of problem with units and defaults, and the names in `values` of its result.

    For an editor such as VS Code with Even Better TOML, run gtmodel schema KIND --json-schema > KIND.schema.json and
    write #:schema ./KIND.schema.json as the first line of the problem file. KIND is robot for robot files.
    """
    if for_editors:
        with answering(context, False, kind or "schema"):
            print(_editor_schema(kind, as_json), end="")
        return
    from gtmodel.problem_files import editor_schema as described, names

    with answering(context, as_json, kind or "schema") as answer:
        document: dict[str, Any] = {"kinds": names()} if kind is None else described.document(kind)
        answer.data = document
    if as_json:
        return
    if kind is None:
        terminal.table(("kind", "what it is"), names().items())
        return
    keys = []
    for key, what, unit, default, text in (key.values() for key in document["keys"]):
        stated = f"default {default}" if default not in ("", "required") else default
        keys.append(("   ".join(filter(None, (key, what, unit and f"[{unit}]", stated))), text))
    terminal.entries(keys, f"{kind}: {document['description']}")
    print()
    values = document["values"].items()
    rows = [(f"{name}   [{about['unit']}]" if about["unit"] else name, about["description"]) for name, about in values]
    terminal.entries(rows, "in values of the result:")


@app.command()
def doctor(context: typer.Context, as_json: Json = False) -> None:
    """Show versions, solvers, compiler, extras and cache of this machine, for a bug report.

    Exit code 0 if gtmodel can solve problems here; otherwise the message says what to do.
    """
    from gtmodel._doctor.report import HEAD, examined

    with answering(context, as_json, "doctor") as answer:
        report = examined()
        answer.data = report.document()
    if not as_json:
        terminal.table(HEAD, report.cells())
        if report.ok:
            print(f"\n{report.message}")
    if not report.ok:
        print(report.message, file=sys.stderr)
        raise typer.Exit(1)


@app.command()
def solve(
    context: typer.Context,
    problem: Problem,
    settings: Set = None,
    out: Out = None,
    as_json: Json = False,
    plot: Annotated[
        bool, typer.Option("--plot", help="Draw pictures and scenes; into ./NAME-result without --out.")
    ] = False,
    report: Report = False,
    max_seconds: Annotated[
        float | None, typer.Option(metavar="S", help="Time limit; the best iterate is kept.")
    ] = None,
    start: Annotated[
        Path | None, typer.Option(metavar="RESULT", help="Start from the result.json of an earlier --out.")
    ] = None,
    write_failed: WriteFailed = False,
    workers: Workers = None,
    cluster: Cluster = None,
    quiet: Quiet = False,
) -> None:
    """Solve a problem. Ctrl-C and SIGTERM stop it and keep the best iterate.

    The result is the same for any number of workers.
    """
    from gtmodel import _crew
    from gtmodel.problem_files import run

    with answering(context, as_json, problem) as answer:
        loaded = answer.load(problem, settings)
        job = run.context_of(loaded, max_seconds=max_seconds, start=start)
        folder = out or (Path(f"{job.name}-result") if plot or report else None)
        page = partial(run.about_problem, loaded, job, ["--write-failed"] * write_failed) if report else None
        with terminal.watching(job, quiet=quiet), _crew.crew_of(workers, cluster) as crew:
            answer.finished = run.solve(loaded, job, out=folder, plot=plot, write_failed=write_failed, about=page)
        if (workers or cluster) and not crew.used:
            print(f"{problem}: this problem has no independent rows; the workers were not used", file=sys.stderr)
        if plot and not answer.finished.outcome.figures:
            print(f"{problem}: this result has no picture", file=sys.stderr)


def _beginnings(prefix: str) -> list[str]:
    from gtmodel.problem_files.files import shipped_names

    return [n for n in ("model", "robot", *_kinds(""), *shipped_names()) if n.startswith(prefix)]


@app.command()
def new(
    context: typer.Context,
    what: Annotated[
        str,
        typer.Argument(
            metavar="KIND|PROBLEM|MODEL|ROBOT", autocompletion=_beginnings,
            help="Kind, see gtmodel schema; shipped problem, see gtmodel list; or the word model or robot.",
        ),
    ],
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="New file, without ending; the first word if left out.")
    ] = None,
    kind: Annotated[
        str | None, typer.Option(metavar="KIND", autocompletion=_beginnings, help="Kind, after the word problem.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option("--from", metavar="LOG", help="Recording of a calibration: its columns and units.")
    ] = None,
) -> None:  # fmt: skip
    """Write a commented file to begin with, which works unchanged, and the files that it needs.

    It has a description for each key. The word model stands for a model in Python, with a problem that simulates it.
    """
    with answering(context, False, what):
        from gtmodel import _new

        beginning = _new.of_kind(what, kind)
        paths, command = _new.write(beginning, name or beginning, log)
    for path in paths:
        print(f"wrote {path}")
    print(f"\ntry: {command}")


@app.command()
def view(
    context: typer.Context,
    what: Annotated[
        str,
        typer.Argument(metavar="ROBOT|RESULT", help="Robot, as after robot = in a problem file; or folder of --out."),
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE.html", help="Page, or .png, .gif or .mp4; NAME.html if left out."),
    ] = None,
    at: Annotated[float | None, typer.Option("--at", metavar="SECONDS", help="Instant of a .png; the first.")] = None,
) -> None:
    """Write a page with a robot in space, each drive moved to and fro, or with the motion or the scene of a result.

    RESULT/NAME is one of several scenes. Those that the folder does not keep, as with --plot, are computed again.

    The page is one file that needs no network.
    """
    from gtmodel.problem_files.base import Context

    with answering(context, False, what):
        from gtmodel import _view

        path = _view.write(what, out, at, Context(notice=lambda sentence: print(sentence, file=sys.stderr)))
    print(f"wrote {path}")


@app.command()
def watch(
    context: typer.Context,
    problem: Problem,
    settings: Set = None,
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="Port of the page; 0 for a free one.")] = 0,
) -> None:
    """Solve a problem again whenever its file changes, and show its report in a browser on this machine.

    The page reloads by itself. Ctrl-C ends.
    """
    with answering(context, False, problem):
        from gtmodel import _watch
        from gtmodel.problem_files.load import refuse_twice

        refuse_twice(settings or ())
        _watch.watch(problem, settings or (), port, lambda sentence: print(sentence, flush=True))


@app.command()
def sweep(
    context: typer.Context,
    problem: Problem,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUES",
            help="a:b:n for n values from a to b; x,y,z; a CSV file; or a distribution for --random; repeatable.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="DIR", help="Folder of the table; finished rows stay.", callback=_folder),
    ] = None,
    settings: Set = None,
    random: Annotated[int | None, typer.Option("--random", metavar="N", help="Number of random samples.")] = None,
    seed: Annotated[int, typer.Option(metavar="S", help="Seed of the samples.")] = 0,
    design: Annotated[str, typer.Option(metavar="NAME", help="Samples: random, sobol or lhs.")] = "random",
    part: Annotated[str | None, typer.Option(metavar="I/N", help="Run the I-th of N parts, for job arrays.")] = None,
    merge: Annotated[bool, typer.Option("--merge", help="Run nothing; make one table of the finished rows.")] = False,
    runs: Annotated[bool, typer.Option("--runs", help="Keep the result folder of each row in DIR/runs.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Draw curves over one key, a map over two.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write table.parquet too; needs the extra logs.")] = False,
    show: Annotated[list[str] | None, typer.Option(metavar="COLUMN", help="Column to draw; repeatable.")] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes; 0 for this one. Default: one per usable core.")
    ] = None,
    cluster: Cluster = None,
    as_json: Json = False,
    max_seconds: Annotated[float | None, typer.Option(metavar="S", help="Time limit; finished rows are kept.")] = None,
    quiet: Quiet = False,
) -> None:
    """Solve a problem for many values of its keys, on all cores or a cluster, into one table.

    Ctrl-C and SIGTERM stop all workers. The same command with the same folder runs only the rows that are missing.
    Exit code 1 if a row failed or is missing.
    """
    with answering(context, as_json, problem) as answer:
        from gtmodel import _sweep_command
        from gtmodel.problem_files import run

        loaded = answer.load(problem, settings)
        job = run.context_of(loaded, max_seconds=max_seconds)
        folder = out or (Path(f"{job.name}-sweep") if plot else None)
        with terminal.watching(job, "stopping; finished rows are kept", quiet=quiet):
            answer.finished = _sweep_command.run(
                loaded, vary or (), job, out=folder, samples=random, seed=seed, method=design, part=part, merge=merge,
                runs=runs, plot=plot, parquet=parquet, show=show or (), workers=workers, cluster=cluster,
            )  # fmt: skip


@app.command()
def inspect(
    context: typer.Context,
    file: Annotated[str, typer.Argument(metavar="FILE", help="Log: text, MATLAB, Parquet, or a ROS bag.")],
    delimiter: Annotated[
        str | None, typer.Option(metavar="NAME", help="comma, semicolon, tab, blank or bar; detected if left out.")
    ] = None,
    decimal: Annotated[str | None, typer.Option(metavar="NAME", help="Decimal sign: point or comma.")] = None,
    header: Annotated[
        int | None, typer.Option(metavar="LINE", help="Line of the column names, from 1; 0 if there is none.")
    ] = None,
    encoding: Annotated[str | None, typer.Option(metavar="NAME", help="Such as cp1252; UTF-8 if left out.")] = None,
    stream: Annotated[str | None, typer.Option(metavar="NAME", help="Read only this stream, such as a topic.")] = None,
    samples: Annotated[
        str | None, typer.Option(metavar="NAME", help="rows or columns: direction of the samples in a matrix.")
    ] = None,
    most_growth: Annotated[
        float | None, typer.Option(metavar="TIMES", help="Largest unpacked size, as a multiple of the file size; 200.")
    ] = None,
    out: Out = None,
    as_json: Json = False,
    plot: Annotated[bool, typer.Option("--plot", help="Draw the log; into ./NAME-log without --out.")] = False,
    max_seconds: Annotated[
        float | None, typer.Option(metavar="S", help="Time limit; the rows read so far are used.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Show the contents of a log: columns, guessed units with reasons, rates, jitter, gaps, clocks, ranges."""
    from gtmodel import _inspect
    from gtmodel.problem_files.base import Context

    options = {
        "delimiter": delimiter, "decimal": decimal, "header": header, "encoding": encoding, "stream": stream,
        "samples": samples, "most_growth": most_growth,
    }  # fmt: skip
    with answering(context, as_json, file) as answer:
        answer.kind, answer.title = _inspect.KIND, Path(file).name
        job = Context(name=Path(file).stem, max_seconds=max_seconds)
        folder = out or (Path(f"{job.name}-log") if plot else None)
        fields = {name: value for name, value in options.items() if value is not None}
        with terminal.watching(job, "stopping with the rows read so far", quiet=quiet):
            answer.finished = _inspect.run(file, fields, job, out=folder, plot=plot)


@app.command()
def codegen(
    context: typer.Context,
    problem: Problem,
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="DIR", help="Folder to write the code into.", callback=_folder)
    ],
    check: Annotated[bool, typer.Option("--check", help="Compile the code and compare it with Python.")] = False,
    costs: Annotated[
        bool, typer.Option("--costs", help="Check, and measure machine code, stack and instructions of each function.")
    ] = False,
    certify: Annotated[
        bool, typer.Option("--certify", help="Prove the functions over their box; write certificate and checker.")
    ] = False,
    fmu: Annotated[
        str | None,
        typer.Option("--fmu", metavar="3|2|both", help="Write functional mock-up units of FMI 3.0, 2.0 or both."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.html", help="Write one page about the code and its checks.")
    ] = None,
    settings: Set = None,
    as_json: Json = False,
    write_failed: WriteFailed = False,
    quiet: Quiet = False,
) -> None:
    """Generate the C code of a robot's functions. With --check, code that fails a check is not written."""
    from gtmodel.problem_files import run

    with answering(context, as_json, problem) as answer:
        from gtmodel import _report

        answer.brief = True
        loaded = answer.load(problem, settings)
        job = run.context_of(loaded)
        if report is not None:
            _report.refuse_another(report, "--report")
        with terminal.watching(job, "stopping after this step", quiet=quiet):
            answer.finished = run.generate(
                loaded,
                job,
                out,
                verify=check or costs,
                write_failed=write_failed,
                fmu=fmu,
                costs=costs,
                certify=certify,
            )
        if report is not None:
            words = ["-o", out.name, *["--check"] * check, *["--costs"] * costs, *(["--fmu", fmu] if fmu else [])]
            about = _report.asked(loaded, job, [*words, "--report", report.name], "codegen")
            answer.finished.files.append(_report.write(report, answer.finished.outcome, about))


app.command(
    "certify", help="Prove what a problem of kind certificate claims at every point of its box; the same as solve."
)(solve)


@app.command()
def loop(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that gtmodel codegen wrote.")],
    peer: Annotated[str, typer.Option("--peer", metavar="egm|rsi", help="Protocol of the simulated controller.")],
    seconds: Annotated[float, typer.Option("--seconds", metavar="N", help="Length of each of the two runs.")],
    law: Annotated[
        str, typer.Option(metavar="LAW", help="trajectory, dynamics, replay, path, lead_through or predictive.")
    ] = "trajectory",
    reference: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Motion to follow: the reference.csv of gtmodel solve --out.")
    ] = None,
    plant: Annotated[
        Path | None, typer.Option(metavar="FMU", help="Unit to simulate as the plant, see [plant] of the problem.")
    ] = None,
    plant_timeout: Annotated[
        float | None, typer.Option(metavar="S", help="Time limit of a call of the unit; plant.timeout_s, or 60 s.")
    ] = None,
    lockstep: Annotated[bool, typer.Option("--lockstep", help="Run cycle by cycle, as fast as possible.")] = False,
    elastic: Annotated[
        float | None,
        typer.Option("--elastic", metavar="HZ", help="Arm on springs behind the motors; rigid if left out."),
    ] = None,
    deceleration: Annotated[
        float | None,
        typer.Option(metavar="M_S2", help="Braking after a lost connection; the reference's largest if left out."),
    ] = None,
    following: Annotated[
        float | None,
        typer.Option(metavar="M", help="Brake if a cart is farther behind; by the drives if left out."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="OUT", help="Results; DIR/loop by default.", callback=_folder)
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run the 4 ms loop with generated code against a simulated controller on loopback, without and with its law."""
    from gtmodel import _loop_command
    from gtmodel.problem_files.base import Context

    with answering(context, as_json, str(folder)) as answer:
        answer.kind, answer.title = "loop", f"{peer}: {law}"
        job = Context(name=folder.name)
        with terminal.watching(job, "stopping the loop, nothing will be compared", quiet=quiet):
            answer.finished = _loop_command.run(
                folder, out or folder / "loop", job, reference=reference, plant=plant, peer=peer, seconds=seconds,
                law=law, plant_timeout=plant_timeout, in_lockstep=lockstep, elastic=elastic, deceleration=deceleration,
                **({} if following is None else {"following": following}),
            )  # fmt: skip


def _editor_schema(kind: str | None, as_json: bool) -> str:
    from gtmodel.problem_files import InputError, names
    from gtmodel.problem_files.editor_schema import text_of

    if as_json:
        raise InputError("--json-schema is JSON already; leave --json out")
    if kind is None:
        raise InputError(f"--json-schema needs a kind: {', '.join(names())}; or robot for robot files")
    return text_of(kind)


def _commands() -> set[str]:
    return {c.name or c.callback.__name__ for c in app.registered_commands if c.callback is not None}


_whole = cache(lambda: get_command(app))  # for the second call of `main` in a process, as from a notebook


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    terminal.opened()
    terminal.printable()
    try:
        terminal.interruptible()
        code = _whole()(args=words, prog_name="gtmodel", standalone_mode=False)
        sys.stdout.flush()
    except TyperException as error:  # a wrong option, or no command at all
        return refused(error, words, _commands())
    except BrokenPipeError:  # the reader closed the pipe, as in `gtmodel list | head`
        terminal.hush()
        return 1
    except OSError as error:  # commands handle errors of their files: this one is from the terminal, pipe or disk
        terminal.hush()
        print(f"gtmodel: the output cannot be printed: {error.strerror or error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("gtmodel: stopped before there was a result", file=sys.stderr)
        return 1
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    sys.exit(main())
