# Everything a person does with this repository. Each target does all of its own set-up.
PYTHON ?= python3
TASK ?= pick_place
SEEDS ?= 10
ARGS ?=
# Tests run on all cores; PARALLEL= runs one after another.
PARALLEL ?= -n logical --maxprocesses 8 --dist worksteal

BIN := .venv/bin
STAMP := .venv/.stamp
DOCS_STAMP := .venv/.stamp-docs

.PHONY: help setup run demo test test-all lint bench doctor docs

help:
	@echo "make run [TASK=pick_place] [SEEDS=10] [ARGS=...]   train, then draw curves and videos (TASK=all: all five)"
	@echo "make demo      a minute or two of training, with its curve and a video"
	@echo "make test      the quick tests;  make test-all: the slow ones as well"
	@echo "make lint      ruff and mypy;    make bench: speed against peers and limits (15 minutes)"
	@echo "make doctor    what this machine can do, and how to mend what it cannot"
	@echo "make docs      the documentation as web pages: build/docs/index.html"

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@echo "==> setup: creating .venv and installing the pinned versions (a few minutes the first time)"
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, $(PYTHON) is " + sys.version.split()[0] + "; choose another with PYTHON=python3.x" if sys.version_info < (3, 11) else 0)'
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt \
		$(BIN)/python -m pip install -qq --constraint constraints.txt --editable '.[dev,notebooks]'
	@touch $(STAMP)

run: $(STAMP)
	@echo "==> run: training $(TASK) over $(SEEDS) seeds into runs/"
	$(BIN)/python launch/run.py --task=$(TASK) --seeds=$(SEEDS) $(ARGS)

demo: $(STAMP)
	@echo "==> demo: a minute or two of real training (two seeds of a pendulum), its curve and a video"
	$(BIN)/python launch/run.py --task=pendulum_climb --seeds=2 --subgoal_layers=1 --periods=4 \
		--config.episodes_per_period=60 --out=runs/demo

test: $(STAMP)
	@echo "==> test: the quick tests"
	$(BIN)/python -m pytest -m "not slow" $(PARALLEL) $(ARGS)

test-all: $(STAMP) $(DOCS_STAMP)
	@echo "==> test-all: every test, the slow ones as well"
	$(BIN)/python -m pytest $(PARALLEL) $(ARGS)

lint: $(STAMP)
	@echo "==> lint: ruff check, ruff format, mypy"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(STAMP)
	@echo "==> bench: speed against peers and the machine's limits (a quarter of an hour), into analysis/data/bench.json"
	$(BIN)/python -m tests.bench $(ARGS)

doctor: $(STAMP)
	@echo "==> doctor: what this machine can do"
	$(BIN)/python launch/doctor.py

$(DOCS_STAMP): $(STAMP)
	PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt \
		$(BIN)/python -m pip install -qq --constraint constraints.txt --editable '.[docs]'
	@touch $(DOCS_STAMP)

docs: $(DOCS_STAMP)
	@echo "==> docs: building build/docs/index.html; a warning is an error"
	$(BIN)/python -m sphinx -W --keep-going -q -d build/doctrees docs build/docs
