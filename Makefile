# The workbook's main jobs. `make` alone lists them.

PYTHON ?= python3
PY := .venv/bin/python
RUN := $(PY) -m workbook
CHANGES := tests/test_try_changing.py
STALL := $(if $(STALL_MINUTES),--stall-minutes $(STALL_MINUTES))
STUDY := OPENBLAS_NUM_THREADS=1 $(PY) -m studies
PYTEST := OPENBLAS_NUM_THREADS=1 $(PY) -m pytest --numprocesses 2 --dist worksteal

PIP := $(PY) -I -m pip install --quiet --no-user --require-hashes
# uv takes seconds, and only what is asked for; where it can't be had, pip installs the whole lock.
UV := PATH="$$PATH:.venv/bin" uv pip install --quiet --python $(PY) --require-hashes --constraint requirements.lock

# Settings of the user's that would reach into the environment or change what it computes.
unexport PIP_PREFIX PIP_TARGET PIP_USER VIRTUAL_ENV
unexport PYTHONHOME PYTHONOPTIMIZE PYTHONPATH PYTHONSAFEPATH PYTHONSTARTUP PYTHONUSERBASE PYTHONWARNINGS
unexport PYTEST_ADDOPTS PYTEST_DISABLE_PLUGIN_AUTOLOAD PYTEST_PLUGINS
unexport $(filter IPYTHON% JUPYTER% MPL%,$(.VARIABLES))

.DEFAULT_GOAL := help
.PHONY: writable $(shell sed -nE 's/^([a-z-]+):.*\#\# .*/\1/p' Makefile)

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

all: writable .venv/.installed  ## every notebook, figure, table, verdict, the report and the article
	@mkdir -p .make
	@$(RUN) run --due --watch $$PPID $(STALL); code=$$?; echo $$code > .make/status; [ $$code -lt 2 ] || exit $$code
	@$(MAKE) --no-print-directory .make/workbook.done
	@exit $$(cat .make/status)

run: .venv/.installed  ## one notebook: make run NOTEBOOK=notebooks/06_characteristic_figure12.py
	$(RUN) run $(STALL) $(NOTEBOOK)

quick: .venv/.installed  ## the same figures from few repeats, into results/quick
	$(RUN) run --quick $(STALL)
	$(RUN) report --quick
	$(RUN) check --quick || true

test: .venv/.test  ## the tests, on the committed results, but for the slow ones; ONLY=data: those that need files
	$(PYTEST) -m "$(if $(ONLY),$(ONLY) and )not slow" $(CHANGES:%=--ignore %)

slow: .venv/.slow  ## the slow tests: notebooks executed again, browsers, long searches
	$(PYTEST) -m slow $(CHANGES:%=--ignore %)

changes: .venv/.test  ## make every change that a notebook proposes; each must run and end in a sentence
	$(PYTEST) $(CHANGES)

check: .venv/.installed  ## print the tables with their verdicts; fails if a cell differs unexpectedly
	@$(RUN) check

show: .venv/.installed  ## a number with its verdict: make show CELL=table2.row02.mean; RERUN=1 computes it again
	@$(RUN) show $(if $(RERUN),--rerun) '$(or $(CELL),Table 2)'

diff: .venv/.installed  ## cells and claims whose verdict is not the last commit's; LAB=1 compares what make lab made
	@$(RUN) diff $(if $(LAB),--lab)

report: .venv/.installed  ## results/report.html from the results
	$(RUN) report

article: .venv/.installed  ## results/article.pdf from the results; FINAL=1 refuses while names or addresses are open
	$(RUN) article $(if $(FINAL),--final)

bench: .venv/.installed  ## time what was made fast against a direct arm, into results/bench.csv
	OPENBLAS_NUM_THREADS=1 $(PY) -m studies.timings

studies: .venv/.installed  ## slow studies whose tables are kept: make studies NAME=claims (make studies lists them)
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

lab: .venv/.lab  ## JupyterLab on copies of the notebooks, in lab/
	$(RUN) lab
	JUPYTERLAB_SETTINGS_DIR=lab/.settings $(PY) -m jupyterlab $$([ "$$(id -u)" != 0 ] || echo --allow-root) --ServerApp.root_dir=lab --LabApp.default_url=/lab/tree/00_the_sensor.ipynb

lint: .venv/.lint  ## style, format, types and spelling
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m codespell_lib
	$(PY) -m djlint --lint --quiet workbook/report/templates studies/pages
	$(if $(shell command -v node),for script in workbook/report/templates/*.js; do node --check $$script || exit 1; done)

audit: .venv/.lock  ## known vulnerabilities of the locked versions
	PATH="$$PATH:.venv/bin" uv tool run pip-audit --requirement requirements.lock --disable-pip

GROUPS := workbook test slow lint lab lock
lock: .venv/.lock  ## pin the newest versions that pyproject.toml allows
	PATH="$$PATH:.venv/bin" uv pip compile pyproject.toml --quiet --upgrade --universal --python-version 3.11 --all-extras \
	  $(GROUPS:%=--group %) --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements.lock

clean:  ## remove what can be made again and is not committed
	rm -rf .make .staging* results/quick results/offline results/lab notebooks/partial notebooks/beyond/partial .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# ---------------------------------------------------------------------------------------------------------------

writable:
	@[ -w . ] || { echo "$(CURDIR) is read-only: copy it to where you may write, then run make there" >&2; exit 2; }

.venv/.installed: pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed: make PYTHON=...")'
	rm -rf .venv
	$(PYTHON) -m venv .venv
	# Whatever is started from this environment, an editor's kernel too, finds the packages of the folder it lies in. The
	# path is relative, so that a copied or moved checkout finds its own.
	$(PY) -I -c 'import pathlib, sysconfig; pathlib.Path(sysconfig.get_path("purelib"), "checkout.pth").write_text("../../../..\n")'
	sed -n '/^uv==/,/[^\\]$$/p' requirements.lock > .venv/uv.lock
	command -v uv > .venv/uv.path || $(PIP) --requirement .venv/uv.lock || true
	$(UV) --requirement pyproject.toml --extra plot --extra xlsx --group workbook || $(PIP) --requirement requirements.lock
	touch $@

# What a target needs besides: a group of pyproject.toml.
.venv/.%: .venv/.installed
	$(UV) --group $* || $(PIP) --requirement requirements.lock
	touch $@

# What is due is told by `run --due`: notebooks that this checkout has not run, or whose sources have changed since.
# A notebook that fails (1) keeps neither the others nor the report from being made, but make from ending well. A run
# that was interrupted (130; a killed make too), or that another one locks out (2), ends there.
.make/workbook.done: $(wildcard results/outcomes/*.json workbook/*.py workbook/report/*.py workbook/report/templates/*.* workbook/report/templates/sections/*.* article/*.* replication/data/*.*)
	$(RUN) report
	$(RUN) article || true
	$(RUN) check || true
	@touch $@
