# The workbook's main jobs. `make` alone lists them.
.error : GNU make is needed, often called gmake

override SHELL := /bin/sh
PYTHON ?= python3
PY := .venv/bin/python
RUN := $(PY) -m workbook
PYTEST := OPENBLAS_NUM_THREADS=1 $(PY) -m pytest --numprocesses 2 --dist worksteal
# KERNEL=Haswell or Prescott: NumPy without SIMD, and numba for a generic processor; of the kernels, Prescott needs no AVX.
SIMD = $(shell $(PY) -c 'import numpy; s = numpy.show_config("dicts")["SIMD Extensions"]; print(*s.get("found", []), *s.get("not found", []))')
OTHER = $(if $(KERNEL),OPENBLAS_CORETYPE=$(KERNEL) NUMBA_CPU_NAME=generic NPY_DISABLE_CPU_FEATURES="$(SIMD)")

# Settings of the user's that would change what a command computes.
unexport PYTHONDONTWRITEBYTECODE PYTHONHOME PYTHONINSPECT PYTHONOPTIMIZE PYTHONPATH PYTHONSAFEPATH PYTHONSTARTUP PYTHONUSERBASE PYTHONWARNINGS
unexport PYTEST_ADDOPTS PYTEST_DISABLE_PLUGIN_AUTOLOAD PYTEST_PLUGINS VIRTUAL_ENV
unexport $(filter IPYTHON% JUPYTER% MPL% NUMBA%,$(.VARIABLES))

.DEFAULT_GOAL := help
.PHONY: $(shell sed -nE 's/^([a-z-]+):.*\#\# .*/\1/p' Makefile)

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

# Two notebooks at a time, the longest first; one that fails keeps neither the others nor the report from being made, but
# make from ending well. What this make starts, sub-makes and kernels too, ends with it, in whatever way it ends; a kernel
# in compiled code when that returns.
all: .venv/.installed  ## every notebook, figure, table and verdict, and the report
	@due=$$($(RUN) due) || exit; export MAKE_PID=$$PPID; \
	test -z "$$due" || $(MAKE) --no-print-directory --keep-going --jobs 2 $$due; failed=$$?; \
	$(RUN) report && exit $$failed

run/%:
	@$(RUN) run $*

# ONLY=data: those that need files; ONLY=portable KERNEL=Prescott: those that compute, as on another processor.
test: .venv/.test  ## the tests, on the committed results, but for the slow ones
	$(OTHER) $(PYTEST) -m "$(if $(ONLY),$(ONLY) and )not slow"

slow: .venv/.slow  ## the slow tests: notebooks executed again, browsers, long searches
	$(PYTEST) -m slow $(TESTS)

check: .venv/.installed  ## print every number with its verdict; fails if one differs unexpectedly
	@$(RUN) check

# FULL=1: a row of each kept table is made again, too.
verify: .venv/.installed $(if $(FULL),.venv/.studies)  ## verification.md and .json, to send back: what ran here, and is it what is committed
	@$(RUN) verify $(if $(FULL),--full)

lab: .venv/.lab  ## JupyterLab on copies of the notebooks, in lab/
	@$(RUN) lab

book: .venv/.installed  ## the report and the notebooks as a book with a search: results/book/index.html
	$(PY) -m sphinx --quiet --jobs 2 --conf-dir workbook --doctree-dir .make/doctrees . .make/book
	rm -rf results/book && cp -r .make/book results/book

bench: .venv/.bench  ## time what was made fast against a direct arm, and the search's peers
	OPENBLAS_NUM_THREADS=1 $(PY) -m studies.timings

studies: .venv/.studies  ## slow studies whose tables are kept: make studies NAME=claims (make studies lists them)
	OPENBLAS_NUM_THREADS=1 $(PY) -m studies $(or $(NAME),--help)

data: .venv/.installed  ## fetch and verify the authors' data
	$(RUN) data

lint: .venv/.lint  ## style, format, types and spelling
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m codespell_lib

audit: .venv/.installed  ## known vulnerabilities of the locked versions
	PATH="$$PATH:.venv/bin" uv tool run pip-audit --strict --requirement requirements.lock --disable-pip

GROUPS := workbook studies bench test slow lint lab lock
lock: .venv/.installed  ## pin the newest versions that pyproject.toml allows
	PATH="$$PATH:.venv/bin" uv pip compile pyproject.toml --quiet --upgrade --universal --python-version 3.11 --all-extras \
	  $(GROUPS:%=--group %) --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements.lock

clean:  ## remove what can be made again and is not committed
	rm -rf .make results/book results/offline .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# .venv/.installed is what notebooks need; .venv/.NAME is a group of pyproject.toml, what a target needs besides.
INSTALL = @[ -w . ] || { echo 'This folder is read-only: copy it to where you may write, then run make there' >&2; exit 2; }; \
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed: make PYTHON=...")' && \
	$(PYTHON) -E -s -m workbook.install $@
# A Python that is asked for is compared with that of .venv.
.venv/.installed: pyproject.toml requirements.lock $(if $(filter-out file,$(origin PYTHON)),FORCE)
	$(INSTALL)
.venv/.%: .venv/.installed
	$(INSTALL)
FORCE:
