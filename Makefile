# The workbook's main jobs. `make` alone lists them.

PYTHON ?= python3
PY := .venv/bin/python
RUN := $(PY) -m workbook
STUDY := OPENBLAS_NUM_THREADS=1 $(PY) -m studies
PYTEST := OPENBLAS_NUM_THREADS=1 $(PY) -m pytest --numprocesses 2 --dist worksteal

WRITABLE := [ -w . ] || { echo 'This folder is read-only: copy it to where you may write, then run make there' >&2; exit 2; }

# For a recipe: the make that was started first lives, and is no zombie (where there is a /proc).
MAKE_LIVES := kill -0 $${MAKE_PID:-$$PPID} && ! grep -qs ') Z ' /proc/$${MAKE_PID:-$$PPID}/stat

# After a command: it ends when make does.
WHILE_MAKE_LIVES = & job=$$!; while $(MAKE_LIVES) && kill -0 $$job; do sleep 1; done 2> /dev/null; \
	$(MAKE_LIVES) || kill $$job; wait $$job

# Where the clock is behind, a stamp gets the time of what it was made from; else all would be installed each time.
STAMP = touch $@; for made_from in $^; do [ ! "$$made_from" -nt $@ ] || touch -r "$$made_from" $@; done

PIP := $(PY) -I -m pip install --quiet --no-user --require-hashes
# uv takes seconds, and only what is asked for; where it can't be had, pip installs the whole lock.
UV := PATH="$$PATH:.venv/bin" uv pip install --quiet --python $(PY) --require-hashes --constraint requirements.lock

# Settings of the user's that would reach into the environment or change what it computes.
unexport PIP_PREFIX PIP_TARGET PIP_USER VIRTUAL_ENV
unexport PYTHONDONTWRITEBYTECODE PYTHONHOME PYTHONOPTIMIZE PYTHONPATH PYTHONSAFEPATH PYTHONSTARTUP PYTHONUSERBASE PYTHONWARNINGS
unexport PYTEST_ADDOPTS PYTEST_DISABLE_PLUGIN_AUTOLOAD PYTEST_PLUGINS
unexport $(filter IPYTHON% JUPYTER% MPL%,$(.VARIABLES))

.DEFAULT_GOAL := help
.PHONY: $(shell sed -nE 's/^([a-z-]+):.*\#\# .*/\1/p' Makefile)

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

# Two notebooks at a time, the longest first; one that fails keeps neither the others nor the report from being made, but
# make from ending well. Each run watches this make, and none starts without it: killed in whatever way, it leaves
# nothing that computes.
all: .venv/.installed  ## every notebook, figure, table and verdict, and the report
	@$(WRITABLE); $(PY) -I workbook/stamps.py; export MAKE_PID=$$PPID; $(MAKE) --no-print-directory --keep-going --jobs 2 $(STAMPS); status=$$?; \
	$(MAKE_LIVES) && $(MAKE) --no-print-directory .make/report.ran || status=1; exit $$status

test: .venv/.test  ## the tests, on the committed results, but for the slow ones; ONLY=data: those that need files
	$(PYTEST) -m "$(if $(ONLY),$(ONLY) and )not slow"

slow: .venv/.slow  ## the slow tests: notebooks executed again, browsers, long searches
	$(PYTEST) -m slow $(TESTS)

check: .venv/.installed  ## print every number with its verdict; fails if one differs unexpectedly
	@$(RUN) check

verify: .venv/.installed  ## verification.json, to send back: versions, processor, hashes of the results, verdicts
	@$(RUN) verify

lab: .venv/.lab  ## JupyterLab on copies of the notebooks, in lab/
	@$(WRITABLE)
	$(RUN) lab
	JUPYTERLAB_SETTINGS_DIR=lab/.settings $(PY) -m jupyterlab $$([ "$$(id -u)" != 0 ] || echo --allow-root) \
	  --LabApp.default_url=/lab/tree/lab/00_the_sensor.ipynb

book: .venv/.installed  ## the report and the notebooks as a book with a search: results/book/index.html
	$(PY) -m sphinx --quiet --jobs 2 --conf-dir workbook --doctree-dir .make/doctrees . .make/book
	rm -rf results/book && cp -r .make/book results/book

bench: .venv/.studies  ## time what was made fast against a direct arm, into results/bench.csv
	OPENBLAS_NUM_THREADS=1 $(PY) -m studies.timings

studies: .venv/.studies  ## slow studies whose tables are kept: make studies NAME=claims (make studies lists them)
	$(STUDY) $(or $(NAME),--help)

# NumPy without SIMD and numba for a generic processor; of the kernels, Katmai (Prescott) needs no AVX.
KERNELS ?= Haswell Prescott
WHICH ?= portable
portable: .venv/.test  ## the tests that compute, and the cheap notebooks' verdicts, as on other processors
	@simd="$$($(PY) -c 'import numpy; s = numpy.show_config("dicts")["SIMD Extensions"]; print(*s.get("found", []), *s.get("not found", []))')"; \
	for kernel in $(KERNELS); do \
	  OPENBLAS_CORETYPE=$$kernel NUMBA_CPU_NAME=generic NPY_DISABLE_CPU_FEATURES="$$simd" $(PYTEST) -m "$(WHICH)" || exit 1; \
	done

data: .venv/.installed  ## fetch and verify the authors' data
	$(RUN) data

lint: .venv/.lint  ## style, format, types and spelling
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m codespell_lib

audit: .venv/.lock  ## known vulnerabilities of the locked versions
	PATH="$$PATH:.venv/bin" uv tool run pip-audit --requirement requirements.lock --disable-pip

GROUPS := workbook studies test slow lint lab lock
lock: .venv/.lock  ## pin the newest versions that pyproject.toml allows
	PATH="$$PATH:.venv/bin" uv pip compile pyproject.toml --quiet --upgrade --universal --python-version 3.11 --all-extras \
	  $(GROUPS:%=--group %) --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements.lock

clean:  ## remove what can be made again and is not committed
	rm -rf .make results/book results/offline .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# ---------------------------------------------------------------------------------------------------------------

.venv/.installed: pyproject.toml requirements.lock
	@$(WRITABLE)
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed: make PYTHON=...")'
	rm -rf .venv
	$(PYTHON) -m venv .venv
	# Whatever is started from this environment, an editor's kernel too, finds the packages of the folder it lies in. The
	# path is relative, so that a copied or moved checkout finds its own.
	$(PY) -I -c 'import pathlib, sysconfig; pathlib.Path(sysconfig.get_path("purelib"), "checkout.pth").write_text("../../../..\n")'
	sed -n '/^uv==/,/[^\\]$$/p' requirements.lock > .venv/uv.lock
	sed '/^uv==/,/[^\\]$$/d' requirements.lock > .venv/all.lock
	@echo 'The locked versions are being installed into .venv'
	@command -v uv > .venv/uv.path || { $(PIP) --requirement .venv/uv.lock $(WHILE_MAKE_LIVES); } || true
	@{ $(UV) --requirement pyproject.toml --extra plot --extra xlsx --group workbook $(WHILE_MAKE_LIVES); } || \
	  { $(PIP) --requirement .venv/all.lock $(WHILE_MAKE_LIVES); }
	@$(STAMP)

# What a target needs besides: a group of pyproject.toml.
.venv/.%: .venv/.installed
	@$(WRITABLE)
	@{ $(UV) --group $* $(WHILE_MAKE_LIVES); } || { $(PIP) --requirement .venv/all.lock $(WHILE_MAKE_LIVES); }
	@$(STAMP)

# A notebook is due when this checkout has not run it yet, when what it made is no longer as it was, or when it, a
# package or a kept table that it reads has changed since. `run` makes its stamp; none is made where the authors' files
# could not be had.
PACKAGES := $(wildcard replication/*.py replication/data/*.* workbook/*.py)
BEYOND := $(wildcard backlash/*.py backlash/*/*.py backlash/data/* studies/*.py studies/*/*.py studies/*.csv)
.make/%.ran: notebooks/%.py $(PACKAGES) .venv/.installed
	@$(MAKE_LIVES) && $(RUN) run $<
.make/%.ran: notebooks/beyond/%.py $(PACKAGES) $(BEYOND) .venv/.installed
	@$(MAKE_LIVES) && $(RUN) run $<

# NAME.py that reads results/TABLE.csv makes this a prerequisite of .make/NAME.ran.
READERS := $(wildcard notebooks/*.py notebooks/*/*.py) workbook/report.py
$(foreach rule,$(shell grep -oE 'kept_table."[a-z0-9_]+"|read_kept."[a-z0-9_]+"|read_realisations' $(READERS) /dev/null | \
  sed -E 's|read_realisations|."table2_realisations"|; s|.*/(.*)\.py:.*"(.*)"|.make/\1.ran:results/\2.csv|'),$(eval $(rule)))
results/%.csv:
	@echo '$@ is missing; git checkout brings it back, or make studies' >&2; exit 2

NOTEBOOKS := $(notdir $(basename $(wildcard notebooks/[0-9]*.py notebooks/beyond/[0-9]*.py)))
ORDER := $(shell sort -t , -k 2 -rn results/notebook_times.csv | cut -d , -f 1)
STAMPS := $(patsubst %,.make/%.ran,$(filter $(NOTEBOOKS),$(ORDER)) $(filter-out $(ORDER),$(NOTEBOOKS)))

.make/report.ran: $(wildcard results/*.csv results/outcomes/*.json workbook/*.*) $(PACKAGES)
	$(RUN) report
	$(RUN) check || true
