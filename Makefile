# Everything runs in this clone's own environment, .venv, which the first call sets up: for the demo with what
# that needs, for everything else with all the tools.
# It only needs make and a Python: `make demo`, `make test`, `make help`.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
FOR_DEMO := $(VENV)/.for_demo
FOR_ALL := $(VENV)/.for_all

# Tests already run one process per core: more threads inside each only slow them down.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
# Where it is set, each of the processes that tests start would compile every library anew: three times the
# processor time of importing xarray.
unexport PYTHONDONTWRITEBYTECODE
# Plots are drawn to files, also where there is no screen.
export MPLBACKEND ?= Agg

# Of the fuzzers: another one each day, and one's own to repeat a run.
SEED ?= $(shell date +%Y%m%d)

.DEFAULT_GOAL := help
# Targets share .venv and two cores: only what `test` runs two at a time sets this.
ifndef AT_ONCE
.NOTPARALLEL:
endif
.PHONY: help install demo test lint format hooks types unit quick search mutants arm verify faults docs playground \
  examples wheel commands bench clean

help: ## Show this list
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 12

install: $(FOR_ALL) ## Set up .venv with every tool (the other targets do so by themselves)

define environment
@command -v "$(PYTHON)" >/dev/null || { \
  echo "No '$(PYTHON)' found. Install Python 3.10 or newer, or say where it is: make PYTHON=/path/to/python3"; exit 1; }
@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
  echo "armgpi needs Python 3.10 or newer; $$("$(PYTHON)" --version 2>&1) is too old. Choose another: make PYTHON=/path/to/python3"; exit 1; }
@"$(PYTHON)" -c 'import ensurepip, venv' 2>/dev/null || { \
  echo "This Python lacks its venv module. On Debian or Ubuntu: apt install python3-venv"; exit 1; }
@$(BIN)/python -m pip --version >/dev/null 2>&1 || { \
  echo "Setting up $(VENV), once ..."; "$(PYTHON)" -m venv --clear $(VENV); }
endef

# Not compiled to bytecode at once: Python does so itself for the modules that are imported, a fraction.
PIP_INSTALL = $(BIN)/python tools/install.py --disable-pip-version-check --no-warn-script-location \
  --no-compile -c constraints.txt

$(FOR_DEMO): pyproject.toml constraints.txt
	$(environment)
	@echo "Installing armgpi and its packages into $(VENV), once; with a usual connection this takes a minute or two:"
	@$(PIP_INSTALL) -e ".[viz]"
	@touch $@

$(FOR_ALL): pyproject.toml constraints.txt
	$(environment)
	@echo "Installing armgpi and all tools into $(VENV), once; with a usual connection this takes some minutes:"
	@$(PIP_INSTALL) -e ".[all,dev,docs]"
	@touch $(FOR_DEMO) $@

demo: $(FOR_DEMO) ## Simulate and compare the controllers on the demo arm, into demo_out/, with a report to open
	@echo "Simulating the demo arm under GPI and under a PID that measures positions too (examples/demo.yaml) ..."
	$(BIN)/armgpi compare --config examples/demo.yaml --out demo_out --force --report demo_out/report.html
	@echo "Now open demo_out/report.html in a browser."
	@echo "To type armgpi commands here: source $(BIN)/activate; pip install example-robot-data brings arms such as ur5."

# The tests come last: cheap checks fail first, and the run ends with pytest's own summary. They run the
# examples as well. What keeps one core busy runs two at a time.
test: lint ## Everything CI checks
	@$(MAKE) --no-print-directory AT_ONCE=yes -j 2 wheel types docs
	@$(MAKE) --no-print-directory unit

lint: $(FOR_ALL) ## Style, complexity (ruff), layers of the packages, length of functions
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo --no-cache
	$(BIN)/python tools/structure.py --check

# What --help says of declared parameters stands in a file, so that it waits for no heavy import.
format: $(FOR_ALL) ## Let ruff rewrite what `make lint` would complain about, where it can; write the options of --help
	$(BIN)/python tools/options.py
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

hooks: $(FOR_ALL) ## Let git check the style of each commit (pre-commit)
	$(BIN)/pre-commit install

types: $(FOR_ALL) ## Types, of the tests too (mypy --strict)
	$(BIN)/mypy

# Work stealing gives each process a stretch of the tests, which share what is made once for a file. Many start
# `armgpi`: where PYTHONDONTWRITEBYTECODE is set, each would compile it anew, for half a second.
unit: $(FOR_ALL) ## The tests
	$(BIN)/python -m compileall -q armgpi
	$(BIN)/pytest -n auto --dist worksteal --minutes

quick: $(FOR_ALL) ## The tests of what changed against main, and the fast ones of all
	$(BIN)/python tools/quick.py

search: $(FOR_ALL) ## What holds for every robot and file: new random examples, and the fuzzers with their counts
	$(BIN)/pytest -n auto --dist worksteal -m "hypothesis or search" --hypothesis-profile=search
	$(BIN)/python tools/fuzz_urdf.py --count 3000 --seed $(SEED)
	$(BIN)/python tools/fuzz.py yaml --count 3000 --seed $(SEED)
	$(BIN)/python tools/fuzz.py rollout --count 3000 --seed $(SEED)
	$(BIN)/python tools/fuzz.py arguments --count 400 --seed $(SEED)
	for what in weights trajectory netcdf mcap log armlog identification task certificate mjcf repaired drives; do \
		$(BIN)/python tools/fuzz.py $$what --count 3000 --seed $(SEED) || exit 1; done
	for what in tune contend zoo sweep rare; do \
		$(BIN)/python tools/fuzz.py $$what --count 300 --seed $(SEED) || exit 1; done

mutants: $(FOR_ALL) ## Planted bugs that the tests of their modules do not find
	$(BIN)/python tools/mutants.py --planted
	$(BIN)/python tools/mutants.py --count 60 --seed $(SEED)

arm: $(FOR_ALL) ## Exported controllers on an emulated Cortex-M7: bits and instructions
	$(BIN)/python tools/arm.py

verify: $(FOR_ALL) ## Exported C proved by Frama-C: torques within limits, no alarm
	$(BIN)/python tools/verify.py

faults: $(FOR_ALL) ## Every fault of every target, into docs/faults.md and its table
	$(BIN)/python tools/faults.py

docs: $(FOR_ALL) ## The documentation, into build/docs; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -q docs build/docs

playground: $(FOR_ALL) ## Pages to play with, into build/playground (docs/play.md)
	$(BIN)/python tools/playground.py

# Run from build/examples: they work from any folder, and what they write stays out of the way.
examples: $(FOR_ALL) ## Run every example, with no screen
	@mkdir -p build/examples
	@set -e; for f in examples/[!_]*.py; do [ -e "$$f" ] || continue; \
	  echo "python $$f"; (cd build/examples && "$(CURDIR)/$(BIN)/python" "$(CURDIR)/$$f"); done

wheel: $(FOR_ALL) ## Build the wheel, and try it and README's commands in fresh environments
	$(BIN)/python tools/check_wheel.py

commands: $(FOR_ALL) ## Run the fenced commands of every page and notebook in fresh environments
	$(BIN)/python tools/commands.py

bench: $(FOR_ALL) ## Run every benchmark, into build/benchmarks
	$(BIN)/python benchmarks/all.py

clean: ## Remove what make wrote, .venv too
	rm -rf $(VENV) build dist demo_out .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
