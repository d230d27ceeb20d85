# Everything that is done with this repository. `make help` lists it.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help setup run test check bench paper clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'

setup: $(STAMP) ## create .venv, install the package and look for the system's libraries

$(STAMP): pyproject.toml scripts/system_libraries.sh
	@sh scripts/system_libraries.sh venv $(PYTHON)
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@sh scripts/system_libraries.sh egl
	@touch $@

run: $(STAMP) ## pick an apple on the simulated cell
	$(BIN)/pomona run trees/pick_apple.yaml

test: $(STAMP) ## run the tests
	@sh scripts/system_libraries.sh chromium
	$(BIN)/python -m pytest -n 2

check: test ## what CI runs: tests, lint, types, layer rules
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(STAMP) ## the 25 cells of the paper, one seed each, with times per skill
	rm -rf runs/campaign_pick
	$(BIN)/pomona campaign benchmarks/pick.yaml

paper: $(STAMP) ## the paper's experiments, with and without refinement, and a report beside its tables
	$(BIN)/pomona campaign benchmarks/paper.yaml
	$(BIN)/python benchmarks/paper_report.py runs/campaign_paper docs/paper

clean: ## remove the virtual environment and caches (records in runs/ stay)
	find executive skills drivers -name __pycache__ -prune -exec rm -rf {} +
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache *.egg-info
