# make run   plays the embedded story: measure, fit, diagnose, add the missing effect, control before and after
# make test  lint, types and tests
# Both make .venv first and install the versions of constraints.txt into it, again only when that file or pyproject.toml
# changed. PYTHON=... chooses the interpreter, WORKERS=... the number of test processes.

VENV := .venv
BIN := $(VENV)/bin
WORKERS ?= 2
STORY ?= -m controllers.study --chain --out pneuid-demo/story --overwrite

FITS := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11 python; do \
	if $$p -c '$(FITS)' 2>/dev/null; then echo $$p; exit; fi; done; echo python3)
INSTALL := $(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt

.PHONY: run test clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

run: $(VENV)/.installed-core
	$(BIN)/python $(STORY)

test: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal

clean:
	rm -rf pneuid-demo build dist .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find pneuid controllers scenarios tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
	@echo "Kept: $(VENV) (remove the folder to start from nothing)"

$(VENV)/.installed-core: pyproject.toml constraints.txt | $(BIN)/pip
	@echo "Installing pneuid and its pinned dependencies into $(VENV) (a few minutes the first time) ..."
	@$(INSTALL) -e .
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(BIN)/pip
	@echo "Installing pneuid, its pinned dependencies and the test tools into $(VENV) (a few minutes the first time) ..."
	@$(INSTALL) -e '.[dev]'
	@touch $(VENV)/.installed-core $@

$(BIN)/pip:
	@$(PYTHON) -c '$(FITS)' 2>/dev/null || { \
		echo "pneuid needs Python 3.11, 3.12 or 3.13; none was found. Install one, or: make $(MAKECMDGOALS) PYTHON=/path/to/python3" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
		echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu: apt install python3-venv, then make again" >&2; exit 1; }
	@echo "Making $(VENV) with $$($(PYTHON) --version) ..."
	@$(PYTHON) -m venv $(VENV)
