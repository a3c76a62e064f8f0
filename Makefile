# Two commands need nothing but Python 3.11 or later: make demo and make test.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
OUT    ?= out
PEERS  := emcee scipy filterpy pints numpyro blackjax

# Python keeps what it compiles, also where the surroundings forbid it: without that, every command
# that starts compiles its libraries again, which takes longer than an estimate.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help demo test docs check format lint types contract unit attack bench recordings samples lock clean

help: ## this list
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) \
	 else "Python %d.%d found, but 3.11 or later is needed: make PYTHON=python3.12 …" % v[:2])'
	@echo "Making an environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	@echo "Installing bayes_asv and what it needs; this takes a minute"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/.tested: requirements-dev.txt pyproject.toml | $(VENV)/bin/python
	@echo "Installing what the tests need, in the versions locked; this takes a minute or two"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --require-hashes -r requirements-dev.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@ $(VENV)/.installed

demo: $(VENV)/.installed ## the whole way on shipped data, with a report at the end
	@mkdir -p $(OUT)
	$(BIN)/bayes-asv demo -o $(OUT)

test: $(VENV)/.tested ## install what the tests need and run every check
	sh tests/debian-packages.sh
	$(MAKE) check

docs: $(VENV)/.tested ## the site of the documentation, in docs/_build/html
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html

check: format lint contract ## every check, nothing installed
	$(MAKE) -j 2 types unit

format:
	$(BIN)/ruff format --check .

lint:
	$(BIN)/ruff check .

types:
	nice $(BIN)/mypy bayes_asv tests benchmarks

contract:
	$(BIN)/lint-imports

unit:
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist worksteal --durations 30

attack: $(VENV)/.tested ## attack every reader and command: ATTACK="--inputs 100000 --minutes 30"
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.attack $(ATTACK)

$(VENV)/peers/.installed: | $(VENV)/.tested
	@echo "Installing the peers in an environment of their own"
	@$(BIN)/python -m venv $(VENV)/peers
	@$(VENV)/peers/bin/python -m pip install --quiet --disable-pip-version-check $(PEERS)
	@touch $@

bench: $(VENV)/peers/.installed ## compare the speed with that of peers and of C, alone on the machine
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(BIN)/python -m benchmarks.peers --python $(VENV)/peers/bin/python

recordings: $(VENV)/.tested ## make the shipped recordings again from the rig
	$(BIN)/python -m tests.rig.shipped

samples: $(VENV)/.installed ## make the sample reports again
	$(BIN)/bayes-asv demo -o reports
	sh tests/picture.sh reports/demo.html reports/demo.png

lock: $(VENV)/.tested ## lock the newest versions that development and its checks use, and list their licences
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes \
	 --no-header --extra dev --output-file requirements-dev.txt pyproject.toml
	$(MAKE) $(VENV)/.tested
	$(BIN)/python -m tests.licences_page

clean: ## remove what was built
	rm -rf $(VENV) $(OUT) docs/_build build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
