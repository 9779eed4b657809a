.PHONY: install test check format demo figures bench-accuracy scenes deb rig-vm clean

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

install: $(BIN)/.installed

$(BIN)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

test: install check
	$(BIN)/python -m pytest -n 2 --cov --cov-report=term:skip-covered --cov-fail-under=90 tests

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

figures: install
	$(BIN)/python -m tests.bench.figures --write

bench-accuracy: install
	$(BIN)/python -m tests.bench.accuracy

scenes: install
	$(BIN)/python scenes/render.py room --out build/scenes/room

deb:
	packaging/deb.sh

rig-vm:
	tests/rigvm/rig_vm.sh

clean:
	rm -rf $(VENV) build demo .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .coverage*
