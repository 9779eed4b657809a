.PHONY: install test check imports matrix format demo figures bench-accuracy bench-ranges bench-replay bench-load life opencv golden soak scenes deb rig-vm clean

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

install: $(BIN)/.installed

$(BIN)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

test: install check
	$(BIN)/python -m pytest -n 3 --durations=15 --cov --cov-report=term:skip-covered --cov-fail-under=90 tests

check: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: install
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

demo: install
	$(BIN)/ptzd demo --out demo

# Every fault of the camera in every state of the machine
matrix: install
	PTZD_MATRIX=all $(BIN)/python -m pytest -n 2 tests/e2e/test_matrix.py

# Who imports whom, room by room
imports: install
	$(BIN)/python -m tests.structure.graph

figures: install
	$(BIN)/python -m tests.bench.figures --write

# Everything in docs/accuracy.md and README's table; renders the scenes first where they are missing
bench-accuracy: install
	$(BIN)/python -m tests.bench.accuracy --write
	$(BIN)/python -m tests.bench.timing --write

# The golden logs under other versions of OpenCV: make opencv VERSIONS="4.10 4.13"
opencv: install
	$(BIN)/python -m tests.bench.opencv $(VERSIONS)

# What learned ranges are worth with 0, 10, 50 and 200 locks
bench-ranges: install
	$(BIN)/python -m tests.bench.ranges --write

# How fast a stop is under floods of requests, wildcards and stalled listeners
bench-load: install
	$(BIN)/python -m tests.bench.load

# A rig that lives at random with every fault: make life MINUTES=60
life: install
	$(BIN)/python -m tests.bench.life $(or $(MINUTES),60)

bench-replay: install
	$(BIN)/python -m tests.bench.replay

# Records the golden logs anew and shows how their decisions changed: make golden NAMES="lock update"
golden: install
	$(BIN)/python tests/golden/make.py $(NAMES)

# The log at full rate: make soak MINUTES=5
soak: install
	$(BIN)/python -m tests.log.soak $(or $(MINUTES),20)

# Renders the ray-traced scenes that are missing or older than their sources: make scenes NAMES="yard"
scenes: install
	$(BIN)/python scenes/cache.py $(NAMES)

deb:
	packaging/deb.sh

rig-vm:
	tests/rigvm/rig_vm.sh

clean:
	rm -rf $(VENV) build demo .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .coverage*
