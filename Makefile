# The workbook's main jobs. `make` alone lists them.

PYTHON ?= python3
PY := .venv/bin/python
RUN := $(PY) -m replication
export PYTHONPATH := $(CURDIR)

NOTEBOOKS := $(sort $(basename $(notdir $(wildcard notebooks/[0-9]*.py))))
STAMPS := $(NOTEBOOKS:%=.make/%.done)

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help all quick test check report data lab lint lock clean

help:  ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

all: .make/workbook.done  ## every notebook, figure, table, verdict and the report

quick: .venv/.installed  ## the same figures from few repeats, into results/quick
	$(RUN) run --quick
	$(RUN) collect --quick
	$(RUN) report --quick
	$(RUN) check --quick || true

test: .venv/.installed  ## all tests, on the committed results
	$(PY) -m pytest

check: .venv/.installed  ## print the verdict table; fails if a cell differs
	$(RUN) check

report: .venv/.installed  ## results/report.html from the results
	$(RUN) report

data: .venv/.installed  ## fetch and verify the authors' data
	$(RUN) data

lab: .venv/.installed  ## JupyterLab on the notebooks
	$(PY) -m jupyterlab notebooks

lint: .venv/.installed  ## style and format
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .

lock: .venv/.installed  ## pin the newest versions that pyproject.toml allows
	$(PY) -m pip install --quiet uv
	$(PY) -m uv pip compile pyproject.toml --quiet --upgrade --universal --python-version 3.11 --extra dev \
	  --extra lab --generate-hashes --no-emit-index-url --no-header --no-annotate --output-file requirements.lock

clean:  ## remove what can be made again and is not committed
	rm -rf .make .staging-* results/quick results/lab notebooks/partial .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +

# ---------------------------------------------------------------------------------------------------------------

.venv/.installed: requirements.lock
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("Python 3.11 or newer is needed: make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(PY) -m pip install --quiet --require-hashes --requirement requirements.lock
	touch $@

# What every notebook needs, then what each needs besides; a stamp says that its outputs are newer than these.
COMMON := $(addprefix replication/,published.py figures.py workbook.py) $(wildcard replication/data/*)
FITS := $(addprefix replication/,datasets.py signature.py identify.py experiments.py)

$(filter .make/01_% .make/02_% .make/03_%,$(STAMPS)): $(FITS)
$(filter .make/04_%,$(STAMPS)): replication/sensor.py

$(STAMPS): .make/%.done: notebooks/%.py $(COMMON) | .venv/.installed
	$(RUN) run --stamp $@ $<

.make/workbook.done: $(STAMPS) replication/report.py
	$(RUN) collect
	$(RUN) report
	$(RUN) readme
	$(RUN) check || true
	mkdir -p .make
	touch $@
