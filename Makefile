# Every target works from a bare clone: the environment is made where it is missing.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.installed
RUNS ?= runs

.PHONY: install demo test check bench results wheel clean

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install -c constraints.txt -e ".[all,dev]"
	$(BIN)/python -m retarget
	touch $@

demo: $(STAMP)
	$(BIN)/rigcast demo

test: $(STAMP)
	$(BIN)/python -m pytest

check: $(STAMP)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: $(STAMP)
	$(BIN)/python benchmarks/cold_start.py --quick
	$(BIN)/python benchmarks/evaluation.py --quick
	$(BIN)/python benchmarks/generators.py --quick
	$(BIN)/python benchmarks/stream.py --quick

results: $(STAMP)
	$(BIN)/python benchmarks/results.py $(RUNS)

wheel: $(STAMP)
	rm -rf dist
	$(BIN)/pip wheel -q --no-deps --wheel-dir dist .
	.ci/wheel dist/rigcast-*.whl

clean:
	rm -rf .venv dist build demo .pytest_cache .ruff_cache .mypy_cache .hypothesis
