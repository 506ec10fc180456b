# Two commands are all a fresh machine needs: `make demo` and `make test`. Both set up .venv when it isn't there.
# Choose the Python with  make PYTHON=python3.13 ...   (3.11 to 3.13)
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO := runs/demo
RUNTIME := $(VENV)/.runtime
DEV := $(VENV)/.dev
DOCS := $(VENV)/.docs

.PHONY: help demo test test-slow check lint format docs notebooks clean

help: ## say what there is
	@grep -E '^[a-z-]+:.*## ' $(firstword $(MAKEFILE_LIST)) | sed -E 's/^([a-z-]+):.*## /\1|/' | awk -F'|' '{printf "make %-10s %s\n", $$1, $$2}'

demo: $(RUNTIME) ## run the default study and say where the report is
	@echo "== Running the default study (minutes; it is resumed if it was stopped)"
	$(BIN)/bayeschute run models/studies/cdt-3-11.toml --out $(DEMO) --resume
	@echo "== Open $(DEMO)/report.html in a browser"

test: $(DEV) ## run the tests
	@echo "== Tests"
	$(BIN)/python -m pytest -n 2

test-slow: $(DEV) ## run the tests that take minutes
	@echo "== Slow tests"
	$(BIN)/python -m pytest -m slow

check: lint test ## format, lint, types, layers, tests

lint: $(DEV) ## format, lint, types, layers
	@echo "== Format, lint, types, layers"
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(DEV) ## put the code into its format
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

docs: $(DOCS) ## build the documentation site into build/site
	@echo "== Documentation"
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "== Open build/site/index.html in a browser"

notebooks: $(DEV) ## run the notebooks and write .ipynb files beside them
	@echo "== Notebooks"
	$(BIN)/python docs/render.py

clean: ## remove the environment and what tools left (not runs/)
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .import_linter_cache

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if (3, 11) <= v < (3, 14) else f"{sys.executable} is Python {v[0]}.{v[1]}; 3.11 to 3.13 is needed: make PYTHON=python3.12 ...")'
	@echo "== Making $(VENV) with $$($(PYTHON) --version)"
	$(PYTHON) -m venv $(VENV)

$(RUNTIME): pyproject.toml constraints.txt | $(VENV)/pyvenv.cfg
	@echo "== Installing bayeschute and what it runs on, versions from constraints.txt"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(DEV): pyproject.toml constraints.txt | $(VENV)/pyvenv.cfg
	@echo "== Installing bayeschute and its development tools, versions from constraints.txt"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $(RUNTIME) $@

$(DOCS): pyproject.toml constraints.txt | $(VENV)/pyvenv.cfg
	@echo "== Installing the tools of the documentation, versions from constraints.txt"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@touch $@
