# Set-up and the commands that everybody needs; `make` lists them. Everything runs in .venv, made on first use.

PYTHON ?= python3
# For pip when it installs torch, e.g. an index of CPU builds (see docs/install.md).
TORCH_FLAGS ?=
# Passed on to the command, e.g. make test ARGS="-k verify" or make demo ARGS="--train".
ARGS ?=
# Processes that run the tests.
WORKERS ?= 2

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# What writes the lock and the bill of materials.
TOOLS := .venv-tools
# Prints torch's version.
TORCH := sed -n 's/^\(torch==[^ ]*\).*/\1/p' requirements.lock
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# mjlab's pins exclude ours.
MJLAB := .venv-mjlab

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

.PHONY: help demo browser test test-mjlab check format bench docs dist lock sbom clean

help:
	@echo "make demo    run the whole line on small real input; prints where the report is (ARGS=\"--train\" trains its own)"
	@echo "make test    run every test (ARGS=\"-m 'not slow'\" leaves out the slow ones)"
	@echo "make browser install Chromium, which tests open pages with, where this is Debian and you are root"
	@echo "make test-mjlab  run what is for mjlab and for Playground, with mjlab and MJX in an environment of its own"
	@echo "make check   lint, formatting, types and the walls of the house"
	@echo "make bench   measure the throughput ratios on this machine"
	@echo "make format  format the code"
	@echo "make docs    build the documentation as a site, build/site"
	@echo "make dist    build wheel and source distribution into dist, and try the wheel in fresh environments"
	@echo "make lock    write requirements.lock from what .venv holds, with hashes"
	@echo "make sbom    write sbom.cdx.json, the bill of materials of requirements.lock"
	@echo "make clean   remove .venv and caches"

demo: $(READY)
	$(BIN)/stiction demo $(ARGS)

# Two processes with a file each at a time, in the order of tests/conftest.py: most tests are of one thread.
test: $(READY)
	STICTION_THREADS=$${STICTION_THREADS:-1} $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder $(ARGS)

# Without one, tests that open pages skip and say so.
browser:
	@for name in chromium chromium-browser google-chrome google-chrome-stable; do \
		command -v $$name >/dev/null && exit 0; done; \
	if test "$$(id -u)" = 0 && grep -qx ID=debian /etc/os-release 2>/dev/null; then \
		apt-get update --quiet=2 && apt-get install --quiet=2 --yes --no-install-recommends chromium; \
	else echo "no Chromium, and no Debian whose root could install it: tests that open pages skip"; fi

test-mjlab: $(MJLAB)/.ready
	MJLAB_WARP_QUIET=1 $(MJLAB)/bin/python -m pytest -p no:cacheprovider tests/exchange/mjlab \
		tests/exchange/convert/test_playground.py $(ARGS)

check: $(READY)
	$(BIN)/ruff check src experiments tests tools
	$(BIN)/ruff format --check src experiments tests tools
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

bench: $(READY)
	$(BIN)/stiction bench $(ARGS)

format: $(READY)
	$(BIN)/ruff check --fix src experiments tests tools
	$(BIN)/ruff format src experiments tests tools

# What the lock does not have comes as pyproject.toml's bounds say.
docs: $(READY)
	@$(BIN)/python -c "import mkdocs, material, mkdocstrings" 2>/dev/null || $(PIP) install -e ".[docs]"
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

dist: $(READY)
	$(BIN)/python tools/dist.py dist --torch-flags="$(TORCH_FLAGS)"

# A build of torch for one kind of machine is named like 2.13.0+cpu; the lock holds for all, but for packages that some
# machines have no wheel of, as in pyproject.toml. Not `pip freeze`, which names the file that torch came from. The
# index knows the hashes of all its files; those of files that are elsewhere, as torch's CPU builds, stay from the lock
# of before while the version is the same.
lock: $(READY) $(TOOLS)/.ready
	$(subst --quiet,,$(PIP)) list --format freeze --exclude-editable --exclude pip | sed -e 's/+.*//' \
		-e "s/^dartpy==.*/&; sys_platform == 'linux'/" \
		-e "s/^sapien==.*/&; platform_machine == 'x86_64' or sys_platform != 'linux'/" > $(VENV)/versions.txt
	cp requirements.lock $(VENV)/hashed.txt
	$(TOOLS)/bin/uv pip compile --quiet --generate-hashes --no-deps --no-header --no-annotate --no-strip-markers \
		--universal --python-version 3.11 $(VENV)/versions.txt --output-file $(VENV)/hashed.txt
	$(BIN)/python tools/lock.py $(VENV)/hashed.txt requirements.lock
	@touch $(READY)

# The bill of materials of what the lock installs, as CycloneDX.
sbom: $(TOOLS)/.ready
	$(TOOLS)/bin/cyclonedx-py requirements requirements.lock --pyproject pyproject.toml --output-reproducible \
		--output-file sbom.cdx.json

$(TOOLS)/.ready: tools.lock
	$(PYTHON) -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip --disable-pip-version-check --quiet install --require-hashes -r tools.lock
	@touch $@

clean:
	rm -rf $(VENV) $(TOOLS) $(MJLAB) build .pytest_cache .mypy_cache .ruff_cache .hypothesis src/stiction.egg-info experiments/*.egg-info

# torch first, as below; with it mjlab.lock is complete, without what its CUDA build needs.
$(MJLAB)/.ready: mjlab.lock pyproject.toml
	$(PYTHON) -m venv $(MJLAB)
	$(subst $(BIN),$(MJLAB)/bin,$(PIP)) install $(TORCH_FLAGS) "$$($(TORCH))"
	$(subst $(BIN),$(MJLAB)/bin,$(PIP)) install --no-deps --require-hashes -r mjlab.lock
	$(subst $(BIN),$(MJLAB)/bin,$(PIP)) install --no-deps -e .
	@touch $@

# torch comes first, of the build that the index offers: by itself pip would choose the one whose hash the index tells,
# with several GB of CUDA. Its hash must be in the lock, unless TORCH_FLAGS names another index. All else is checked by
# pip against the lock, which is complete. Last comes what torch's CUDA build needs beside it, which the lock does not
# have; of a CPU build nothing is left to do.
$(READY): requirements.lock pyproject.toml experiments/pyproject.toml
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and '$(PYTHON) is Python ' + sys.version.split()[0] \
		+ '; stiction needs 3.11 or newer: make PYTHON=python3.12')"
	@echo "installing into $(VENV) (some 2.6 GB; only the first time, or when requirements.lock changes)"
	$(PYTHON) -m venv $(VENV)
	rm -rf $(VENV)/torch
	$(PIP) download --no-deps $(TORCH_FLAGS) --dest $(VENV)/torch "$$($(TORCH))"
	@grep -qFe "$$($(subst --quiet,,$(PIP)) hash $(VENV)/torch/*.whl | tail -1)" requirements.lock || test -n "$(TORCH_FLAGS)" || \
		{ echo "torch's file is none that requirements.lock knows; name its index with TORCH_FLAGS to take it"; exit 1; }
	$(PIP) install --no-deps $(VENV)/torch/*.whl
	rm -rf $(VENV)/torch
	$(PIP) install --no-deps --require-hashes -r requirements.lock
	$(PIP) install $(TORCH_FLAGS) "$$($(TORCH))"
	$(PIP) install --no-deps --no-build-isolation -e . -e ./experiments
	@touch $@
