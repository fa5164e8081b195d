"""The notebooks: they run from top to bottom, hold no outputs, and are made from the scripts beside them."""

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import nbformat
import pytest
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from jupyter_core.utils import run_sync
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

CLONE = Path(__file__).resolve().parents[1]
FOLDER = CLONE / "notebooks"
SCRIPTS = sorted(FOLDER.glob("[0-9][0-9]_*.py"))
# Run at every run, the others in `make proof`: some of those that take little, about models of one's
# own, optimization and code.
AT_EVERY_RUN = {"01", "08", "11"}
CELL_SECONDS = 300  # a hung cell ends here; no statement about speed


def by_name(script: Path) -> str:
    return script.stem


@pytest.fixture(scope="module")
def pair() -> ModuleType:
    spec = importlib.util.spec_from_file_location("pair", FOLDER / "pair.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def stored(script: Path) -> Any:
    return nbformat.read(script.with_suffix(".ipynb"), as_version=nbformat.NO_CONVERT)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AsyncKernelManager]:
    """A kernel of this interpreter that finds no settings of the user; one for all, since it imports for seconds."""
    home = tmp_path_factory.mktemp("kernel")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, (str(CLONE), os.environ.get("PYTHONPATH")))),
        "IPYTHONDIR": str(home / "ipython"),
        "JUPYTER_CONFIG_DIR": str(home / "jupyter"),
        "MPLBACKEND": "Agg",
    }
    # without folders only the kernel of ipykernel's own installation is left, which is that of sys.executable
    manager = AsyncKernelManager(
        kernel_name="python3",
        kernel_spec_manager=KernelSpecManager(kernel_dirs=[]),
        connection_file=str(home / "kernel.json"),
    )
    run_sync(manager.start_kernel)(env=environment, cwd=str(home))
    yield manager
    run_sync(manager.shutdown_kernel)(now=True)


def execute(notebook: Any, kernel: AsyncKernelManager, home: Path) -> Any:
    """The notebook with outputs, run in `home` from an empty namespace."""
    begin = nbformat.v4.new_code_cell(f"%reset -f\n%cd -q {home}")
    notebook.cells.insert(0, begin)
    ran = NotebookClient(notebook, km=kernel, timeout=CELL_SECONDS).execute()
    assert outputs(nbformat.from_dict({"cells": [ran.cells.pop(0)]})) == []
    return ran


def outputs(notebook: Any) -> list[Any]:
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def test_there_are_notebooks_and_each_has_its_script(pair: ModuleType) -> None:
    assert len(SCRIPTS) >= 2
    assert pair.scripts() == SCRIPTS
    assert sorted(FOLDER.glob("*.ipynb")) == [script.with_suffix(".ipynb") for script in SCRIPTS]


@pytest.mark.parametrize("script", SCRIPTS, ids=by_name)
def test_stored_notebook_is_the_one_made_from_the_script(pair: ModuleType, script: Path) -> None:
    found = script.with_suffix(".ipynb").read_bytes().decode()
    assert found == pair.text(script), "the pair differs; edit the script, then run python notebooks/pair.py"


def test_pairs_are_the_same_in_another_process() -> None:
    asked = "import pair; print(*map(pair.text, pair.scripts()), sep='', end='')"
    made = subprocess.run(
        [sys.executable, "-c", asked],
        cwd=FOLDER,
        env={**os.environ, "PYTHONHASHSEED": "1", "PYTHONIOENCODING": "utf-8"},
        capture_output=True,
        check=True,
        timeout=120,
    ).stdout
    assert made == b"".join(script.with_suffix(".ipynb").read_bytes() for script in SCRIPTS)


@pytest.mark.parametrize("script", SCRIPTS, ids=by_name)
def test_stored_notebook_holds_no_outputs(script: Path) -> None:
    notebook = stored(script)
    assert outputs(notebook) == []
    assert all(cell.execution_count is None for cell in notebook.cells if cell.cell_type == "code")


@pytest.mark.parametrize("script", SCRIPTS, ids=by_name)
def test_notebook_asks_a_question_and_asserts_an_answer(script: Path) -> None:
    cells = stored(script).cells
    assert cells[0].cell_type == "markdown" and "?**" in cells[0].source
    assert "## Answer" in cells[-1].source
    code = "\n".join(cell.source for cell in cells if cell.cell_type == "code")
    assert "assert " in code or "assert_allclose" in code


@pytest.mark.slow
@pytest.mark.parametrize(
    "script",
    [pytest.param(s, id=s.stem, marks=() if s.stem[:2] in AT_EVERY_RUN else pytest.mark.proof) for s in SCRIPTS],
)
def test_notebook_runs_from_top_to_bottom(script: Path, kernel: AsyncKernelManager, tmp_path: Path) -> None:
    source = stored(script)
    ran = execute(source, kernel, tmp_path)  # raises at the first error, with the cell and its traceback
    assert all(cell.execution_count for cell in ran.cells if cell.cell_type == "code")
    warned = [output.text for output in outputs(ran) if output.get("name") == "stderr"]
    assert "RuntimeWarning" not in "".join(warned)
    pictures = sum("image/png" in output.get("data", {}) for output in outputs(ran))
    drawn = ("Figure(", "_figure(", ".figure(", ".figures[")
    assert pictures == sum(any(d in c.source for d in drawn) for c in ran.cells if c.cell_type == "code")


def test_an_error_in_a_cell_is_found(kernel: AsyncKernelManager, tmp_path: Path) -> None:
    # what executes the notebooks can fail: an assertion in a cell is not lost, and the interpreter is this one
    cell = nbformat.v4.new_code_cell("import sys\nassert False, sys.executable")
    with pytest.raises(CellExecutionError) as caught:
        execute(nbformat.v4.new_notebook(cells=[cell]), kernel, tmp_path)
    assert "AssertionError" in str(caught.value) and sys.executable in str(caught.value)


def test_a_notebook_sees_nothing_of_the_one_before(kernel: AsyncKernelManager, tmp_path: Path) -> None:
    def printed(source: str) -> str:
        ran = execute(nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source)]), kernel, tmp_path)
        return "".join(output.text for output in outputs(ran))

    asked = "print('left_behind' in globals())"
    assert printed(f"left_behind = 1; {asked}") == "True\n"
    assert printed(asked) == "False\n"
