# Four doors: demo, test, check, bench. Each sets up what it needs. `faults` breaks things on purpose,
# `mutations` breaks the code on purpose, `thesis` measures the thesis' results.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
TESTED := $(VENV)/.tested
# Tests start a hundred processes: each would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test check bench faults mutations hour thesis clean

demo: $(STAMP)
	$(BIN)/caesura demo $(ARGS)

# Five at a time, for tests wait for processes, browsers and clocks; each takes a file at a time, in the order of
# tests/conftest.py, for the tests of a file share what they have simulated and started. Which process takes which:
# tests/harness/scheduling.py. TESTS=all adds the slow ones, three quarters of the time: every test in a browser, and
# those that are marked.
TESTS := quick
test: $(TESTED)
	$(BIN)/python -m pytest -n 5 --dist loadfile --no-loadscope-reorder \
	  $(if $(filter all,$(TESTS)),,-m "not slow") $(ARGS)

check: $(TESTED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --config-file tests/mypy.ini
	$(BIN)/lint-imports
	$(BIN)/python scripts/check_words.py
	$(BIN)/python scripts/write_schema.py --check
	$(BIN)/python scripts/write_vectors.py --check
	$(BIN)/python scripts/write_security.py --check
	$(BIN)/python scripts/write_program_schema.py --check
	scripts/lint_deploy.sh $(BIN)

bench: $(TESTED)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	$(BIN)/python tests/bench/step_cost.py --json dist/bench $(ARGS)
	$(BIN)/python tests/bench/offline_cost.py --json dist/bench
	$(BIN)/python tests/bench/growth.py --json dist/bench
	$(BIN)/python tests/bench/refusal_cost.py --tries 2
	$(BIN)/python tests/bench/start.py --json dist/bench
	$(BIN)/python tests/bench/conditioning_cost.py --json dist/bench
	$(BIN)/python tests/bench/batch_cost.py --json dist/bench
	$(BIN)/python tests/bench/worker_cost.py --json dist/bench
	$(BIN)/python tests/bench/edge_cost.py --json dist/bench
	$(BIN)/python tests/bench/journal_cost.py
	$(BIN)/python tests/bench/watching_cost.py
	$(BIN)/python tests/bench/stored_cost.py --json dist/bench
	$(BIN)/python tests/bench/restart.py --minutes 10
	$(BIN)/python tests/bench/takeover.py
	$(BIN)/python tests/bench/service_load.py --json dist/bench
	$(BIN)/python tests/bench/service_load.py --instances 2

faults: $(TESTED)
	scripts/debian.sh faketime gcc
	PYTHONPATH=tests $(BIN)/python -m faults.suite $(ARGS)

mutations: $(TESTED)
	scripts/debian.sh gcc
	PYTHONPATH=tests $(BIN)/python -m mutations $(ARGS)

hour: $(TESTED)
	$(BIN)/python tests/bench/hour.py $(ARGS)

thesis: $(STAMP)
	$(BIN)/caesura evaluate --suite thesis $(ARGS)

$(STAMP): pyproject.toml constraints.txt
	PYTHON="$(PYTHON)" scripts/setup.sh $(VENV)
	touch $@

# What tests need beyond the demo: tools, a driver of browsers, the packages of exports and viewers. 600 MB installed.
# pytest compiles the test modules here: else each process of the first run compiles all. Errors are for `make test`.
$(TESTED): $(STAMP)
	$(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test]'
	$(BIN)/python -m pytest --collect-only --quiet >/dev/null || true
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache dist
