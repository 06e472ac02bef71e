# Set-up and the commands that everybody needs; `make` lists them. Everything runs in .venv, made on first use.

PYTHON ?= python3
# For pip when it installs torch, e.g. an index of CPU builds (see README.md).
TORCH_FLAGS ?=
# Passed on to the command, e.g. make test ARGS="-k verify" or make demo ARGS="--train".
ARGS ?=
# Processes that run the tests.
WORKERS ?= 2

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet

# One thread policy (core/provenance.py): the libraries' own pools have one thread, the simulator and torch are
# given STICTION_THREADS, or every core.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
export VECLIB_MAXIMUM_THREADS ?= 1

# Measured records for the demo and the tests, which do without where there are none.
ifeq ($(origin STICTION_DATA),undefined)
ifneq ($(wildcard ../shared/data/.),)
export STICTION_DATA := $(abspath ../shared/data)
endif
endif

.PHONY: help demo test check format bench lock clean

help:
	@echo "make demo    run the whole line on small real input; prints where the report is (ARGS=\"--train\" trains its own)"
	@echo "make test    run every test (ARGS=\"-m 'not slow'\" leaves out the slow ones)"
	@echo "make check   lint, formatting, types and the walls of the house"
	@echo "make bench   measure the throughput ratios on this machine"
	@echo "make format  format the code"
	@echo "make lock    write requirements.lock from what .venv holds"
	@echo "make clean   remove .venv and caches"

demo: $(READY)
	$(BIN)/stiction demo $(ARGS)

# Two processes with a file each at a time: most tests are of one thread.
test: $(READY)
	STICTION_THREADS=$${STICTION_THREADS:-1} $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile $(ARGS)

check: $(READY)
	$(BIN)/ruff check src tests scripts
	$(BIN)/ruff format --check src tests scripts
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

bench: $(READY)
	$(BIN)/stiction bench $(ARGS)

format: $(READY)
	$(BIN)/ruff check --fix src tests scripts
	$(BIN)/ruff format src tests scripts

# A build of torch for one kind of machine is named like 2.13.0+cpu; the lock holds for all, but for packages that some
# machines have no wheel of, as in pyproject.toml.
lock: $(READY)
	$(PIP) freeze --all --exclude-editable --exclude pip | sed -e 's/+.*//' \
		-e "s/^dartpy==.*/&; sys_platform == 'linux'/" \
		-e "s/^sapien==.*/&; sys_platform != 'linux' or platform_machine == 'x86_64'/" > requirements.lock
	@touch $(READY)

clean:
	rm -rf $(VENV) build .pytest_cache .mypy_cache .ruff_cache .hypothesis src/stiction.egg-info

# torch comes first: a looser requirement of another package would choose the newest torch, with several GB of CUDA.
$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and '$(PYTHON) is Python ' + sys.version.split()[0] \
		+ '; stiction needs 3.11 or newer: make PYTHON=python3.12')"
	@echo "installing into $(VENV) (some 2.6 GB; only the first time, or when requirements.lock changes)"
	$(PYTHON) -m venv $(VENV)
	$(PIP) install $(TORCH_FLAGS) "$$(grep '^torch==' requirements.lock)"
	$(PIP) install -r requirements.lock
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@
