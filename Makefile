# `make` alone lists the commands. The first one that needs it builds the environment, from the exact
# versions of constraints.txt; stamp files inside it say what it holds, so the next one starts at once.

PYTHON ?= python3
VENV   ?= .venv
JOBS   ?= 2

BIN     := $(VENV)/bin
RUN     := $(BIN)/python -m
# --no-compile: Python compiles what is imported, a small part of what is installed.
INSTALL := $(RUN) pip install -qq --disable-pip-version-check --no-compile --constraint constraints.txt

export MPLBACKEND := Agg
# One BLAS thread in each of the JOBS processes: they do not fight for cores, and sums keep their order.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# Neighbours share fixtures and stay in one process, until the other one has nothing left and takes half of the rest.
# Tests run make themselves, which is not to ask this one for jobs. What is compiled once is kept, whatever the
# environment says: else each of their many processes compiles all of gtmodel anew, 3.2 s in place of 0.9.
PYTEST     := env -u MAKEFLAGS -u MFLAGS -u MAKELEVEL -u PYTHONDONTWRITEBYTECODE $(ONE_THREAD) $(RUN) pytest -n $(JOBS) --dist worksteal

# Another processor: older kernels of OpenBLAS, NumPy and the C library without wide vectors.
OLDER  := NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL" GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F
# What round-off has decided before.
SHAKEN := tests/robots/test_six_link.py::test_declared_branches_reach_the_inverse_kinematics_by_newton \
          tests/identify/test_arm_inertias.py::test_numbers_of_no_body_are_named tests/test_shaking.py

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test types pytest kind proof bench docs dist pictures conformance format schemas constraints clean

help:
	@echo "make demo         solve the time-optimal motion of the L1 prototype, then generate and check its C code"
	@echo "make test         lint, types and all tests: what CI runs; about 16 minutes on two cores"
	@echo "make kind KIND=reach  check one kind of problem: what holds for all kinds, its own tests and its page"
	@echo "make proof        long statistics, formal checks, and the notebooks and pages that make test leaves out"
	@echo "make bench        benchmarks and rivals"
	@echo "make docs         build the site, build/site/html/index.html, with all commands and notebooks run"
	@echo "make dist         build wheel and source archive, install each into an empty environment and try it"
	@echo "make conformance  solve the problems with known optima and write docs/conformance.md"
	@echo "make pictures     draw docs/pictures anew, which README.md shows"
	@echo "make format       bring the Python files into the form that make test asks for"
	@echo "make schemas      write problems/schemas anew, with which editors complete and check the keys of problems"
	@echo "make constraints  resolve constraints.txt anew"
	@echo "make clean        remove what was built and the caches; the environment, $(VENV), stays"
	@echo "PYTHON=python3.12 chooses the interpreter of the environment, JOBS=4 the test processes."

demo: $(VENV)/.core
	$(BIN)/gtmodel solve problems/l1_min_time.toml --plot --out build/demo
	$(BIN)/gtmodel codegen problems/l1_controller.toml -o build/l1 --check

test: $(VENV)/.dev
	@echo "lint, types and all tests: about 16 minutes on two cores, JOBS=4 on four is faster"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@$(MAKE) --no-print-directory --jobs=2 types pytest

# The types at the same time as the tests.
types: $(VENV)/.dev
	$(BIN)/pyrefly check --min-severity error --python-interpreter-path $(BIN)/python

pytest: $(VENV)/.dev
	$(PYTEST)
	$(OLDER) OPENBLAS_CORETYPE=Nehalem $(PYTEST) --shake 1 $(SHAKEN)

# One kind: what holds for all kinds, then what carries its name, also where it is marked 'proof'.
kind: $(VENV)/.dev types
	@test -n "$(KIND)" || { echo "Name the kind: make kind KIND=compliance"; exit 2; }
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(PYTEST) tests/test_house.py tests/test_public_names.py tests/test_start_up.py tests/test_words.py \
	  tests/test_docstrings.py tests/test_readme.py tests/test_cli.py
	$(PYTEST) -m "" -k "$(KIND) or every_page_is_reached" tests/kinds tests/test_docs.py

# pytest ends with 5 where no test carries the marker.
proof: $(VENV)/.dev
	@$(PYTEST) -m proof || { status=$$?; \
	  test $$status -eq 5 && echo "No test is marked 'proof' yet: nothing was proved."; }

# Every script runs, also after one that failed; a script says itself which tool it lacks.
bench: $(VENV)/.bench
	@status=0; ran=0; for script in tests/bench/bench_*.py; do \
	  test -e "$$script" || continue; \
	  ran=1; echo "== $$script"; $(ONE_THREAD) $(BIN)/python "$$script" || status=1; \
	done; \
	test $$ran -eq 1 || echo "No benchmark in tests/bench yet: nothing was measured."; exit $$status

# Those of README.md; the same problem draws the same bytes.
pictures: $(VENV)/.core
	$(ONE_THREAD) $(BIN)/python docs/make_pictures.py

# Strict: a link that leads nowhere, a command or a cell that fails ends the build.
docs: $(VENV)/.docs
	env -u PYTHONDONTWRITEBYTECODE $(ONE_THREAD) $(RUN) sphinx --quiet --fresh-env --write-all --fail-on-warning --keep-going --jobs $(JOBS) \
	  -b html -d build/site/doctrees docs build/site/html
	@echo "The site: build/site/html/index.html"

# Wheel and source archive into dist/; what the release workflow runs.
dist: | $(BIN)/python
	tests/try_archives.sh $(BIN)/python

conformance: $(VENV)/.dev
	$(ONE_THREAD) $(BIN)/python docs/make_conformance.py

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

schemas: $(VENV)/.core
	mkdir -p problems/schemas
	$(BIN)/python -c "from gtmodel.problem_files.editor_schema import write_all; write_all('problems/schemas')"

# A failed or broken-off install leaves no stamp, and the next make repeats it.
$(VENV)/.core: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing gtmodel into $(VENV) ..."
	@$(INSTALL) -e .
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing gtmodel, its tests' tools and the oracles into $(VENV) (some minutes the first time) ..."
	@$(INSTALL) -e '.[dev,oracle]'
	@touch $(VENV)/.core $@

$(VENV)/.bench: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing gtmodel, the oracles and the rivals into $(VENV) (some minutes the first time) ..."
	@$(INSTALL) -e '.[dev,oracle,bench]'
	@touch $(VENV)/.core $(VENV)/.dev $@

$(VENV)/.docs: pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing gtmodel and what builds the site into $(VENV) (a minute or two the first time) ..."
	@$(INSTALL) -e '.[docs]'
	@touch $(VENV)/.core $@

$(BIN)/python:
	@$(PYTHON) -c 'pass' 2>/dev/null || { echo "There is no working '$(PYTHON)'. Name a Python 3.11 or newer: make $(or $(MAKECMDGOALS),test) PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "gtmodel needs Python 3.11 or newer; '$(PYTHON)' is $$($(PYTHON) -c 'import platform; print(platform.python_version())')." \
	       "Name another one: make $(or $(MAKECMDGOALS),test) PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -f $@; \
	  echo "'$(PYTHON) -m venv' failed. On Debian and Ubuntu the package python3-venv may be missing."; exit 1; }

# Resolved in an environment of its own; `list` and not `freeze`, which may write local paths.
constraints: $(BIN)/python
	rm -rf build/resolve && $(BIN)/python -m venv build/resolve
	build/resolve/bin/python -m pip install --quiet --disable-pip-version-check --only-binary :all: -e '.[dev,oracle,bench,notebooks,docs]'
	{ sed -n '/^#/p' constraints.txt; \
	  build/resolve/bin/python -m pip list --format freeze --exclude-editable \
	    --exclude pip --exclude setuptools | LC_ALL=C sort -f; } > build/constraints.txt
	mv build/constraints.txt constraints.txt

clean:
	rm -rf build dist .pytest_cache .ruff_cache .hypothesis
	find . -path './$(VENV)' -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
