.PHONY: help setup run test test-fast test-all lint format clean outdated

PY := .venv/bin/python
STAMP := .venv/.setup-done

# A file's tests share compiled programs; files come in the order of tests/conftest.py, those with slow tests first.
SIDE_BY_SIDE := -n 2 --dist loadfile --no-loadscope-reorder

# Modules set up for another Python, as robot middleware leaves on PYTHONPATH, would shadow the pinned ones.
unexport PYTHONPATH PYTHONHOME

# The time stamps of the files cannot tell that the Python behind .venv was removed, or that the checkout was moved
# with .venv inside it; then .venv is out of date as well.
CURRENT := $(shell tools/find_python.sh $(PY) >/dev/null 2>&1 && [ "$$(cat $(STAMP) 2>/dev/null)" = "$(CURDIR)" ] && echo yes)

help:
	@echo "make setup      build .venv, if it is missing or out of date"
	@echo "make run        first experiment, into runs/first"
	@echo "make test       lint, types and all tests"
	@echo "make test-fast  the tests that take seconds"
	@echo "make lint       ruff and mypy alone"
	@echo "make format     let ruff rewrite the files"
	@echo "make clean      remove caches and build leftovers; .venv and runs stay"

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt $(if $(CURRENT),,outdated)
	@rm -f $@
	@if ! tools/find_python.sh $(PY) >/dev/null 2>&1 || ! $(PY) -m pip --version >/dev/null 2>&1; then \
		python=$$(tools/find_python.sh) || exit 1; \
		echo "setup: .venv with $$python"; \
		rm -rf .venv; \
		"$$python" -m venv .venv; \
	fi
	@echo "setup: packages into .venv (a minute or two, about 1 GB)"
	@$(PY) -m pip install --quiet --disable-pip-version-check --no-input -c constraints.txt -e '.[dev]'
	@printf '%s\n' "$(CURDIR)" >$@

outdated:

run: setup
	@$(PY) -m experiments.first_run --out runs/first

# The recipe begins only when lint has passed, also under make -j.
test: lint
	@$(PY) -m pytest $(SIDE_BY_SIDE)

test-all: test

test-fast: setup
	@$(PY) -m pytest $(SIDE_BY_SIDE) -m "not slow"

lint: setup
	@$(PY) -m ruff check
	@$(PY) -m ruff format --check
	@$(PY) -m mypy

format: setup
	@$(PY) -m ruff check --fix
	@$(PY) -m ruff format

clean:
	@rm -rf build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache
	@find . -name .venv -prune -o -name runs -prune -o -name __pycache__ -type d -exec rm -rf {} +
