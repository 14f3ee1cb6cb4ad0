# Two commands: `make run` executes the course, `make test` checks everything.
# They need Python 3.11-3.13 and make, and the network only the first time.

.DEFAULT_GOAL := help
.PHONY: help run test fuzz coverage mutants soak lock audit clean

# An own choice is possible: make run PYTHON=/path/to/python3.12
PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3 python; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' \
	>/dev/null 2>&1 && echo $$p && break; done)
ENV := .venv/bin
EXECUTE := $(ENV)/jupyter nbconvert --log-level WARN --to notebook --execute --ExecutePreprocessor.record_timing=False \
	--KernelManager.transport=ipc
INSTALLED := .venv/installed.txt
WITH_DASK := .venv/installed-cluster.txt
MEASURING := .venv/installed-measuring.txt
COVERAGE_ENV := PYTHONPATH=$(CURDIR)/.venv/measuring COVERAGE_PROCESS_START=$(CURDIR)/pyproject.toml \
	COVERAGE_FILE=$(CURDIR)/.coverage

# Figures belong into the notebook, whatever the caller's shell asks of matplotlib.
unexport MPLBACKEND
# Jupyter's own notice about its folders is no news to the reader.
export JUPYTER_PLATFORM_DIRS := 1

help:
	@echo "make run    execute project.ipynb, regenerate output_images/ and the annotated video"
	@echo "make test   lint, unit tests, and project.ipynb re-executed and compared by nbval"
	@echo "make fuzz   the tests with random examples, ten times as long and with other examples each time"
	@echo "make coverage  which lines no test runs; make mutants  which mistakes no test notices (docs/testing.md)"
	@echo "make soak   an hour of driving through the command line, with a look at memory, frames and sound"
	@echo "make audit  known vulnerabilities of the packages in requirements.lock; make lock writes that file again"
	@echo "make clean  remove .venv and caches"
	@echo "Real pictures: make run LANES_DATA=path/to/folder   (results: project_real.ipynb, output_real/)"

run: $(INSTALLED)
ifdef LANES_DATA
	@echo "== Running the course on $(LANES_DATA) (some minutes): notebook project_real.ipynb, results in output_real/"
	@$(EXECUTE) --output project_real.ipynb project.ipynb
	@echo "== Done: read project_real.ipynb, see output_real/"
else
	@echo "== Running the course (about a minute): project.ipynb is executed in place"
	@$(EXECUTE) --inplace project.ipynb
	@echo "== Done: read project.ipynb, see output_images/"
endif

test: $(INSTALLED) $(WITH_DASK)
	@echo "== Lint"
	@$(ENV)/ruff check . && $(ENV)/ruff format --check .
	@echo "== Unit tests, then the notebook against its committed outputs (some minutes)"
	@env -u LANES_DATA $(ENV)/python -m pytest tests project.ipynb -n 2 --dist loadfile --nbval --nbval-current-env \
		--nbval-cell-timeout 120 -p tests.end_to_end.compare_figures

fuzz: $(INSTALLED)
	@echo "== Random pictures, files, drives and filter steps: ten times as many as make test (some minutes)"
	@LANES_FUZZ=10 $(ENV)/python -m pytest $(shell grep -rl 'from tests.support.examples import' tests)

# In one process and without the notebook, which is a test of its own, and the speed tests: who counts lines is slow.
# Commands run as processes are counted, too: Python imports `sitecustomize` wherever it starts.
coverage: $(MEASURING) $(WITH_DASK)
	@rm -f .coverage .coverage.*
	@echo "import coverage; coverage.process_startup()" > .venv/measuring/sitecustomize.py
	@env -u LANES_DATA $(COVERAGE_ENV) OMP_NUM_THREADS=1 $(ENV)/python -m coverage run -m pytest tests --ignore=tests/end_to_end/test_engine_speed.py
	@$(COVERAGE_ENV) $(ENV)/python -m coverage combine --quiet
	@$(COVERAGE_ENV) $(ENV)/python -m coverage report --fail-under=95

# OpenCV's own threads do not survive the fork that makes a mutant cheap.
mutants: $(MEASURING)
	@rm -rf mutants
	@PYTHONPATH=.venv/measuring OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 $(ENV)/python -m mutmut run --max-children 1
	@PYTHONPATH=.venv/measuring $(ENV)/python -m mutmut results

soak: $(INSTALLED)
	@echo "== One hour of driving through the command line: frames, sound, memory (half an hour or more)"
	@$(ENV)/python -m tools.soak

# Written last, so that a broken installation is tried again.
$(INSTALLED): requirements.txt
	@test -n "$(PYTHON)" || { echo "No Python 3.11, 3.12 or 3.13 with venv found; install one, or say make PYTHON=/path/to/python"; exit 1; }
	@echo "== Installing requirements.txt into .venv with $(PYTHON) (once)"
	@test -x $(ENV)/python || $(PYTHON) -m venv .venv
	@$(ENV)/python -m pip install --quiet --disable-pip-version-check -r requirements.txt
	@cp requirements.txt $@

# Only the tests of lanes/cluster/ need it; where it cannot be had, they are skipped.
$(WITH_DASK): requirements-cluster.txt $(INSTALLED)
	@echo "== Installing requirements-cluster.txt into .venv (once)"
	@$(ENV)/python -m pip install --quiet --disable-pip-version-check -r requirements-cluster.txt && cp requirements-cluster.txt $@ \
		|| echo "== Dask could not be installed: the tests of many drives are skipped"

# Everything that requirements.txt brings along, by hash, for Python 3.11-3.13 on any system.
lock: $(INSTALLED)
	@$(PYTHON) -m venv .venv/tools && .venv/tools/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	@.venv/tools/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
		--custom-compile-command "make lock" requirements.txt requirements-cluster.txt -o requirements.lock

audit: $(INSTALLED)
	@$(PYTHON) -m venv .venv/tools && .venv/tools/bin/python -m pip install --quiet --disable-pip-version-check pip-audit==2.10.1
	@.venv/tools/bin/python -m tools.audit

# Beside the packages that the project runs with, not among them.
$(MEASURING): requirements-measuring.txt $(INSTALLED)
	@echo "== Installing requirements-measuring.txt into .venv/measuring (once)"
	@$(ENV)/python -m pip install --quiet --disable-pip-version-check --upgrade --target .venv/measuring -r requirements-measuring.txt
	@cp requirements-measuring.txt $@

clean:
	rm -rf .venv .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
