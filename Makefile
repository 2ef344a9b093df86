# Everything a person does with this repository. Each target does all of its own set-up.
PYTHON ?= python3
TASK ?= pick_place
SEEDS ?= 10
ARGS ?=
# Tests run on all cores; PARALLEL= runs one after another.
PARALLEL ?= -n logical --maxprocesses 8 --dist worksteal

BIN := .venv/bin
STAMP := .venv/.stamp

.PHONY: help setup run demo test test-all lint bench doctor docs site hashes audit

help:
	@echo "make run [TASK=pick_place] [SEEDS=10] [ARGS=...]   train, then draw curves and videos (TASK=all: all five)"
	@echo "make demo      train for a minute or two, then draw a curve and a video"
	@echo "make test      the quick tests;  make test-all: the slow ones as well"
	@echo "make lint      ruff and mypy;    make bench: speed against peers and limits (15 minutes)"
	@echo "make doctor    check what this machine can do, and how to fix what fails"
	@echo "make docs      the documentation as web pages: build/docs/index.html"
	@echo "make site      docs, reports and 3-D replays as a static site: build/site/index.html"
	@echo "make hashes    after a change of constraints.txt: the files that setup accepts"
	@echo "make audit     known vulnerabilities of what setup installs"

setup: $(STAMP)

# Files whose hashes are not those of hashes.txt are refused. torch comes in several builds, so its version alone is pinned.
$(STAMP): pyproject.toml constraints.txt hashes.txt
	@echo "==> setup: creating .venv and installing the pinned versions (a few minutes the first time)"
	@$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, $(PYTHON) is " + sys.version.split()[0] + "; choose another with PYTHON=python3.x" if sys.version_info < (3, 11) else 0)'
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install -qq --require-hashes --no-deps -r hashes.txt
	PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install -qq --no-build-isolation --editable '.[dev,docs,notebooks]'
	@touch $(STAMP)

hashes:
	@echo "==> hashes: of the versions in constraints.txt, into hashes.txt"
	$(PYTHON) -m venv build/uv && build/uv/bin/python -m pip install -qq uv
	build/uv/bin/uv pip compile constraints.txt --no-deps --generate-hashes --no-emit-package torch \
		--no-header --no-annotate -q -o hashes.txt

audit:
	@echo "==> audit: known vulnerabilities of the pinned versions; fails if the database cannot be reached"
	$(PYTHON) -m venv build/audit && build/audit/bin/python -m pip install -qq pip-audit
	build/audit/bin/pip-audit --strict --progress-spinner=off --disable-pip --require-hashes -r hashes.txt

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

test-all: $(STAMP)
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

docs: $(STAMP)
	@echo "==> docs: building build/docs/index.html; a warning is an error"
	$(BIN)/python -m sphinx -W --keep-going -q -d build/doctrees docs build/docs

site: docs
	@echo "==> site: published results with reports and replays, and the docs: build/site/index.html"
	$(BIN)/python launch/site.py --output=build/site --docs=build/docs
