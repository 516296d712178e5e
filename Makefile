# The workbook's main jobs. `make` alone lists them.

PYTHON ?= python3
PY := .venv/bin/python
RUN := $(PY) -m workbook
CHANGES := tests/test_try_changing.py
STALL := $(if $(STALL_MINUTES),--stall-minutes $(STALL_MINUTES))
STUDY := OPENBLAS_NUM_THREADS=1 $(PY) -m studies
PYTEST := OPENBLAS_NUM_THREADS=1 $(PY) -m pytest --numprocesses 2 --dist worksteal
export PYTHONPATH := $(CURDIR)
# The make that a user started, not one below it: a run ends with it, even if it is killed.
ifndef TOP_MAKE
export TOP_MAKE := $(shell echo $$PPID)
endif

PAPER := $(wildcard notebooks/[0-9]*.py)
BEYOND := $(wildcard notebooks/beyond/[0-9]*.py)
STAMPS := $(sort $(PAPER:notebooks/%.py=.make/%.done) $(BEYOND:notebooks/beyond/%.py=.make/%.done))

.DEFAULT_GOAL := help
.PHONY: $(shell sed -nE 's/^([a-z-]+):.*\#\# .*/\1/p' Makefile)

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

all: .venv/.installed  ## every notebook, figure, table, verdict, the report and the article
	@$(RUN) free
	@mkdir -p .make && rm -f .make/due
	@$(MAKE) --no-print-directory --keep-going .make/noted
	@if [ -s .make/due ]; then rm -f .make/workbook.done; fi
	@$(MAKE) --no-print-directory --keep-going .make/workbook.done

quick: .venv/.installed  ## the same figures from few repeats, into results/quick
	$(RUN) run --quick $(STALL)
	$(RUN) collect --quick
	$(RUN) report --quick
	$(RUN) check --quick || true

test: .venv/.installed  ## the tests, on the committed results, but for the slow ones
	$(PYTEST) -m "not slow" $(CHANGES:%=--ignore %)

slow: .venv/.installed  ## the slow tests: notebooks executed again, browsers, long searches
	$(PYTEST) -m slow $(CHANGES:%=--ignore %)

changes: .venv/.installed  ## make every change that a notebook proposes; each must run and end in a sentence
	$(PYTEST) $(CHANGES)

check: .venv/.installed  ## print the tables with their verdicts; fails if a cell differs unexpectedly
	$(RUN) check

diff: .venv/.installed  ## cells and claims whose verdict is not the last commit's
	$(RUN) diff

report: .venv/.installed  ## results/report.html from the results
	$(RUN) collect
	$(RUN) report

article: .venv/.installed  ## results/article.pdf from the results; FINAL=1 refuses while names or addresses are open
	$(RUN) article $(if $(FINAL),--final)

bench: .venv/.installed  ## time what was made fast against a direct arm, into results/bench.csv
	OPENBLAS_NUM_THREADS=1 $(PY) -m studies.timings

studies: .venv/.installed  ## slow studies whose tables are kept: make studies NAME=claims (make studies lists them)
	$(STUDY) $(or $(NAME),--help)

# NumPy without SIMD and numba for a generic processor; of the kernels, Katmai (Prescott) needs no AVX.
KERNELS ?= Haswell Prescott
portable: .venv/.installed  ## the tests that compute, and the cheap notebooks' verdicts, as on other processors
	@simd="$$($(PY) -c 'import numpy; s = numpy.show_config("dicts")["SIMD Extensions"]; print(*s.get("found", []), *s.get("not found", []))')"; \
	for kernel in $(KERNELS); do \
	  OPENBLAS_CORETYPE=$$kernel NUMBA_CPU_NAME=generic NPY_DISABLE_CPU_FEATURES="$$simd" $(PYTEST) -m portable || exit 1; \
	done

data: .venv/.installed  ## fetch and verify the authors' data
	$(RUN) data

lab: .venv/.installed  ## JupyterLab on copies of the notebooks, in lab/
	$(RUN) lab
	JUPYTERLAB_SETTINGS_DIR=lab/.settings $(PY) -m jupyterlab $$([ "$$(id -u)" != 0 ] || echo --allow-root) --ServerApp.root_dir=lab --LabApp.default_url=/lab/tree/00_the_sensor.ipynb

lint: .venv/.installed  ## style, format, types and spelling
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy
	$(PY) -m codespell_lib

audit: .venv/.installed  ## known vulnerabilities of the locked versions
	$(PY) -m uv tool run pip-audit --requirement requirements.lock --disable-pip

lock: .venv/.installed  ## pin the newest versions that pyproject.toml allows
	$(PY) -m uv pip compile pyproject.toml --quiet --upgrade --universal --python-version 3.11 --extra dev \
	  --generate-hashes --no-emit-index-url --no-header --no-annotate \
	  --output-file requirements.lock

clean:  ## remove what can be made again and is not committed
	rm -rf .make .staging* results/quick results/offline results/lab notebooks/partial notebooks/beyond/partial .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# ---------------------------------------------------------------------------------------------------------------

.venv/.installed: requirements.lock
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed: make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(PY) -m pip install --quiet --require-hashes --requirement requirements.lock
	touch $@

# A stamp says that a notebook's outputs are newer than what they were made from: its source, the locked versions, and
# what its kernel noted that it read, kept in .make/<notebook>.d. Due notebooks are noted, then run together: their
# stamps are not new before that, so make has to be told that the workbook is due too.
-include $(wildcard .make/*.d)

.PHONY: .make/noted
.make/noted: $(STAMPS)
	@:

$(PAPER:notebooks/%.py=.make/%.done): .make/%.done: notebooks/%.py requirements.lock | .venv/.installed
	@mkdir -p .make && echo $< >> .make/due
$(BEYOND:notebooks/beyond/%.py=.make/%.done): .make/%.done: notebooks/beyond/%.py requirements.lock | .venv/.installed
	@mkdir -p .make && echo $< >> .make/due

# A notebook that fails keeps neither the others nor the report from being made, but make from ending well.
# A run that was interrupted (130; a killed make too), or that another one locks out (2), ends here.
.make/workbook.done: $(STAMPS) $(wildcard workbook/*.py workbook/report/*.py workbook/report/templates/*.j2 article/*.* replication/data/*.*)
	@if [ -s .make/due ]; then $(RUN) run --stamps .make --watch $$TOP_MAKE $(STALL) $$(sort -u .make/due); fi; code=$$?; echo $$code > .make/status; [ $$code -lt 2 ]
	$(RUN) collect
	$(RUN) report
	$(RUN) article || true
	$(RUN) readme
	$(RUN) check || true
	@exit $$(cat .make/status)
	@touch $@
