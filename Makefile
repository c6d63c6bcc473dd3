# Everything starts here: `make reproduce` and `make test` set up what they need. `make help` lists the rest.
PYTHON ?= python3
WORKERS ?= 3
ARGS ?=
MARKS ?=
CC ?= cc
CORE_FLAGS = -std=c99 -O2 -ffp-contract=off -Wall -Wextra -Wpedantic -Wshadow -Werror
BIN = .venv/bin
# One core for each test worker (some wait for boards and pages, so a third has room on two cores); results that do not depend on how many threads a machine has; what pytest makes of the tests, and what is compiled after a change, is kept.
TEST_ENV = OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=

# Two at a time: mypy without its cache needs one core for half a minute, and tests wait for boards and pages.
BESIDE = $(MAKE) --no-print-directory --jobs=2 TOGETHER=1

.PHONY: help python install reproduce test quick check check-slow check-all suite lint types contract core-warnings soak bench docs readme \
	lock site wheel install-test install-site install-boards fix clean
ifndef TOGETHER # what is set up comes before what needs it, even with `make -j`
.NOTPARALLEL:
endif
.SILENT:

help: ## list the targets
	sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24

python:
	command -v $(PYTHON) >/dev/null || { echo "tactuator needs Python 3.11 or later, and there is no $(PYTHON)" >&2; exit 1; }

install: python ## set up .venv with the runtime set and build the core
	$(PYTHON) tools/install.py run

install-test: python
	$(PYTHON) tools/install.py tests
	$(PYTHON) tools/install.py test

install-site: python
	$(PYTHON) tools/install.py site

install-boards: python ## install the cross-compiler and the emulator (apt, as root)
	$(PYTHON) tools/install.py boards

reproduce: install ## the paper end to end, into out/paper
	$(BIN)/tactuator reproduce $(ARGS)

test: install-test lint contract ## everything that must hold: style, types, floors, warnings, tests
	$(BESIDE) suite types core-warnings

quick: install-test lint ## what to run every minute: style, and the tests of single modules
	$(TEST_ENV) $(BIN)/python -m pytest -q -m quick -n 2 $(ARGS)

check-slow: install-site install-test ## what takes minutes: fuzzing, packing, installing for real, the site
	$(PYTHON) tools/install.py slow
	$(MAKE) --no-print-directory 'MARKS=-m "slow and not soak"' suite

check-all: install-site install-test lint contract ## both in one run, as CI does: what waits in one overlaps with the other
	$(PYTHON) tools/install.py slow
	$(BESIDE) 'MARKS=-m "not soak"' suite types core-warnings

check: install-test ## style, types, floors and warnings without the tests
	$(BESIDE) --output-sync types lint contract core-warnings

suite:
	$(TEST_ENV) $(BIN)/python -m pytest $(MARKS) -n $(WORKERS) $(ARGS)

lint:
	$(BIN)/ruff check --quiet
	$(BIN)/ruff format --check --quiet || { echo "some files are not formatted: make fix" >&2; exit 1; }

types:
	$(BIN)/mypy

contract:
	$(BIN)/lint-imports --no-logo 2>&1 || $(BIN)/lint-imports

core-warnings: # each file by itself, so that a header that leans on another shows
	for file in $$(find core -name '*.c'); do $(CC) $(CORE_FLAGS) -Icore -c $$file -o /dev/null || exit 1; done

soak: install-test ## the hours: fuzzing and long properties
	$(TEST_ENV) HYPOTHESIS_PROFILE=soak $(BIN)/python -m pytest -m soak -n $(WORKERS) $(ARGS)

bench: install-test ## ratios against peers, into out/bench.json (ARGS=name for some of them)
	$(TEST_ENV) $(BIN)/python benchmarks/run.py $(ARGS)

wheel: install-test ## sdist, wheel and the list of runtime packages into out/dist, the wheel's tag checked
	$(BIN)/python tools/wheel.py

docs: install-test ## write docs/cli.md and the keys in docs/display.md anew from the program itself
	$(BIN)/python tools/cli_reference.py
	$(BIN)/python tools/display_reference.py
	$(BIN)/python tools/floors.py

site: install-site ## the documentation as pages, into out/site (open out/site/index.html)
	$(TEST_ENV) $(BIN)/python -m sphinx -b html -q -W --keep-going -j auto -c docs/site -d out/site-cache/doctrees $(ARGS) . out/site

readme: install ## write README's picture and table anew from a run
	$(BIN)/python tools/readme_table.py

lock: install-test ## resolve requirements/*.in into the hashed locks (ARGS=--upgrade for the newest)
	$(BIN)/python tools/lock.py $(ARGS)
	$(PYTHON) tools/install.py test

fix: install-test ## put imports and formatting right
	$(BIN)/ruff check --fix --quiet || true
	$(BIN)/ruff format --quiet

clean: ## take away what was built, and .venv
	rm -rf .venv .setup build out .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis src/*.egg-info
	find src -name '_core*.so' -delete
