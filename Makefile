# `make run` executes the course, `make test` checks everything, `make check` is the quick check while you work.
# They need Python 3.11-3.14 and make; the first run needs the network to install the packages.

.DEFAULT_GOAL := help
.PHONY: help run book check test grade lint fuzz coverage mutants soak lock audit clean

# Choose another Python with: make run PYTHON=/path/to/python3.12
PYTHON ?= $(shell for p in python3.14 python3.13 python3.12 python3.11 python3 python; do \
	$$p -c 'import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' \
	>/dev/null 2>&1 && echo $$p && break; done)
ENV := .venv/bin
EXECUTE := $(ENV)/jupyter nbconvert --log-level WARN --to notebook --execute --ExecutePreprocessor.record_timing=False \
	--KernelManager.transport=ipc
# The prints of a cell become one output; the kernel splits them differently in each run.
COALESCE := $(ENV)/jupyter nbconvert --log-level WARN --to notebook --inplace --CoalesceStreamsPreprocessor.enabled=True
INSTALL := $(ENV)/python -m pip install --quiet --disable-pip-version-check
INSTALLED := .venv/installed.txt
OPTIONAL := $(patsubst %,.venv/installed-%.txt,cluster network ros recorders)
MEASURING := .venv/installed-measuring.txt
BOOK := .venv/installed-book.txt
COMPILE := .venv/tools/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--custom-compile-command "make lock"
# All tests. The notebook's own are its cells, compared by nbval, and its exercises. The plugin compares more than nbval.
# A cell takes seconds; the limit is for one that hangs.
ALL_TESTS := project.ipynb tests --nbval --nbval-current-env --nbval-cell-timeout 1200 -p tests.end_to_end.nbval_plugin
# The packages whose unit tests are quick; tests marked `slow` are left to `make test`.
QUICK_TESTS := $(wildcard tests/test_*.py tests/detect tests/tracking tests/video)
COVERAGE_ENV := PYTHONPATH=$(CURDIR)/.venv/measuring COVERAGE_PROCESS_START=$(CURDIR)/pyproject.toml \
	COVERAGE_FILE=$(CURDIR)/.coverage

# Figures belong in the notebook, even if the caller's shell sets another matplotlib backend.
unexport MPLBACKEND
# Without bytecode files each of the many processes would compile every module again.
unexport PYTHONDONTWRITEBYTECODE
# Without it Jupyter prints a notice about its folders.
export JUPYTER_PLATFORM_DIRS := 1

help:
	@echo "make run       execute project.ipynb, regenerate output_images/ and the annotated video"
	@echo "make book      course, guides and API reference as a web site: book/_build/html/index.html"
	@echo "make check     lint, types, import contracts, the quick unit tests (under a minute), and sizes"
	@echo "make test      lint, types, import contracts, all tests, the book, and project.ipynb executed again and compared"
	@echo "make grade NOTEBOOKS=folder   which exercises are passed (docs/teaching.md); CSV=grades.csv also writes a table"
	@echo "make fuzz      the tests with random examples: ten times as many, and other ones in each run"
	@echo "make coverage  lines that no test runs"
	@echo "make mutants   small changes of the code that no test notices (docs/testing.md)"
	@echo "make soak      an hour of video through the command line; checks memory, frames and sound"
	@echo "make lock      write requirements.lock: all packages, with hashes"
	@echo "make audit     look up known vulnerabilities of the packages in requirements.lock"
	@echo "make clean     remove .venv and caches"
	@echo "Real pictures: make run LANES_DATA=path/to/folder   (results: project_real.ipynb, output_real/)"

run: $(INSTALLED)
ifdef LANES_DATA
	@echo "== Running the course on $(LANES_DATA) (some minutes): notebook project_real.ipynb, results in output_real/"
	@$(EXECUTE) --output project_real.ipynb project.ipynb
	@$(COALESCE) project_real.ipynb
	@echo "== Done: read project_real.ipynb, see output_real/"
else
	@echo "== Running the course (about a minute): project.ipynb is executed in place"
	@$(EXECUTE) --inplace project.ipynb
	@$(COALESCE) project.ipynb
	@echo "== Done: read project.ipynb, see output_images/"
endif

# The course is shown as committed. A warning, such as a dead link, fails.
book: $(BOOK)
	@echo "== Building the book (about a minute)"
	@PYTHONPATH=.venv/book $(ENV)/python -m book.build
	@echo "== Done: open book/_build/html/index.html"

lint: $(INSTALLED)
	@echo "== Lint"
	@$(ENV)/ruff check . && $(ENV)/ruff format --check .
	@echo "== Types (pyproject.toml; half a minute the first time, then seconds)"
	@$(ENV)/mypy
	@echo "== Import contracts (pyproject.toml)"
	@$(ENV)/lint-imports --no-logo --no-cache

check: lint $(OPTIONAL)
	@echo "== Quick unit tests"
	@env -u LANES_DATA OMP_NUM_THREADS=1 $(ENV)/python -m pytest $(QUICK_TESTS) -m "not slow" -n 2 --dist loadfile
	@echo "== Sizes and their ceilings (pyproject.toml)"
	@$(ENV)/python -m tools.sizes

test: lint $(OPTIONAL) $(BOOK)
	@echo "== All tests, and the notebook against its committed outputs (some minutes)"
	@env -u LANES_DATA OMP_NUM_THREADS=1 $(ENV)/python -m pytest $(ALL_TESTS) -n 2 --dist loadfile
	@$(ENV)/python -m tools.sizes

# Runs the code of the students: docs/teaching.md says how to isolate it.
grade: $(INSTALLED)
	@test -n "$(NOTEBOOKS)" || { echo 'Name notebooks or folders: make grade NOTEBOOKS="anna.ipynb handed_in/"'; exit 2; }
	@$(ENV)/python -m course.grading $(NOTEBOOKS) $(if $(CSV),--csv $(CSV))

fuzz: $(INSTALLED)
	@echo "== Random pictures, files, drives and filter steps: ten times as many as in make test (some minutes)"
	@LANES_FUZZ=10 $(ENV)/python -m pytest $(shell grep -rl 'from tests.support.examples import' tests)

# One process.
# Python imports `sitecustomize` at every start, so that commands run as processes are counted too.
coverage: $(MEASURING) $(OPTIONAL)
	@rm -f .coverage .coverage.*
	@echo "import coverage; coverage.process_startup()" > .venv/measuring/sitecustomize.py
	@env -u LANES_DATA $(COVERAGE_ENV) OMP_NUM_THREADS=1 $(ENV)/python -m coverage run -m pytest $(ALL_TESTS)
	@$(COVERAGE_ENV) $(ENV)/python -m coverage combine --quiet
	@$(COVERAGE_ENV) $(ENV)/python -m coverage report --fail-under=95

# mutmut forks a process for each mutant, and OpenCV's threads do not survive a fork.
mutants: $(MEASURING)
	@rm -rf mutants
	@PYTHONPATH=.venv/measuring OMP_NUM_THREADS=1 OPENCV_FOR_THREADS_NUM=1 $(ENV)/python -m mutmut run --max-children 1
	@PYTHONPATH=.venv/measuring $(ENV)/python -m mutmut results

# The packets of the project video are repeated, with a tone.
soak: $(INSTALLED)
	@echo "== One hour of video through the command line: frames in, frames out, peak memory (half an hour or more)"
	@mkdir -p .soak && $$($(ENV)/python -c "import imageio_ffmpeg; print(imageio_ffmpeg.get_ffmpeg_exe())") -v error -y \
		-stream_loop 359 -i test_videos/project_video.mp4 -f lavfi -i sine -c:v copy -shortest .soak/long.mp4
	@$(ENV)/python -c "import resource, sys; from lanes.__main__ import main; status = main(sys.argv[1:]); \
		print(f'peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000:.0f} MB'); sys.exit(status)" \
		annotate --camera test_videos/project_video.yaml --no-report .soak/long.mp4 -o .soak/out
	@$(ENV)/python -c "from lanes.video.reader import inspect_video; \
		read, written = map(inspect_video, ('.soak/long.mp4', '.soak/out/long.mp4')); print(read, written, sep='\n'); \
		assert (read.frames, read.duration_s) == (written.frames, written.duration_s) and written.has_audio"
	@rm -r .soak

# The copy is made last, so that a failed installation is repeated.
$(INSTALLED): requirements.txt
	@test -n "$(PYTHON)" || { echo "No Python 3.11 to 3.14 with venv found; install one, or run make PYTHON=/path/to/python"; exit 1; }
	@echo "== Installing requirements.txt into .venv with $(PYTHON) (once)"
	@test -x $(ENV)/python || $(PYTHON) -m venv .venv
	@$(INSTALL) -r requirements.txt
	@cp requirements.txt $@

# The packages of an extra in pyproject.toml, without the project. A range is taken at its lower end, the version that is
# tested. A list that has not changed keeps its date, so that nothing is installed again.
.venv/extra-%.txt: pyproject.toml $(INSTALLED)
	@$(ENV)/python -c "import tomllib; extras = tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']; \
		print('\n'.join(extras['$*']).replace('>=', '=='))" > $@.new
	@if cmp -s $@.new $@; then rm $@.new; else mv $@.new $@; fi

# Only the tests of many drives on a cluster (Dask), of networks of others, and of robot logs (ros: rosbags, mcap;
# recorders: schemas of Foxglove) need these; without them they are skipped.
$(OPTIONAL): .venv/installed-%.txt: .venv/extra-%.txt
	@echo "== Installing the extra $* into .venv (once)"
	@$(INSTALL) -r $< && cp $< $@ || echo "== The extra $* could not be installed: its tests are skipped"

# In folders of their own, apart from the packages that the project runs with.
$(MEASURING) $(BOOK): .venv/installed-%.txt: .venv/extra-%.txt
	@echo "== Installing the extra $* into .venv/$* (once)"
	@$(INSTALL) --upgrade --target .venv/$* -r $<
	@cp $< $@

# All packages that requirements.txt, the book, Dask, networks and robot logs depend on, with hashes, for Python 3.11-3.14.
lock: .venv/extra-book.txt .venv/extra-cluster.txt .venv/extra-network.txt .venv/extra-ros.txt
	@$(PYTHON) -m venv .venv/tools && .venv/tools/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	@$(COMPILE) requirements.txt $^ -o requirements.lock

# --strict: a package without an answer of the advisory service is a failure, too.
audit: $(INSTALLED)
	@$(PYTHON) -m venv .venv/tools && .venv/tools/bin/python -m pip install --quiet --disable-pip-version-check pip-audit==2.10.1
	@.venv/tools/bin/pip-audit --strict --disable-pip --require-hashes --requirement requirements.lock

clean:
	rm -rf book/_build .venv .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
