# Two commands need nothing but Python 3.11 and make: `make demo` and `make test`. Each builds the environment it needs.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
TESTED := $(VENV)/.tested
IMAGING := $(VENV)/.imaging
DOCS := $(VENV)/.docs
INTEROP := .venv-interop
AUDIT := $(VENV)/audit
# Less is imported than pip would compile: it is compiled when it is imported.
PIP := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile
LOCKS := requirements-dev.lock requirements-hardware.lock requirements-imaging.lock requirements-torch.txt requirements-docs.lock \
	requirements-interop.lock
MINUTES ?= 60
TRIALS ?= 300
PACKAGES := labctl instruments protocols sim_backends
SOURCES := $(PACKAGES) tests benchmarks docs

# Real data sets, where a copy lies beside the checkout; tests that need them say so and skip where it does not.
ifneq ($(wildcard ../shared/data),)
export LABCTL_DATA ?= $(abspath ../shared/data)
endif

# Hundreds of processes begin: not each is to compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test tested test-full test-kill test-light docs picture interop truth fuzz audit check format lock clean

demo: $(INSTALLED)
	$(BIN)/labctl demo

# What is checked has one process, and the tests begin with one core: side by side.
test: $(TESTED) $(IMAGING)
	$(MAKE) --jobs 2 check tested

# Three at once on two cores: many tests wait for an instrument that does not answer.
tested: $(TESTED) $(IMAGING)
	$(BIN)/pytest -m "not full" --numprocesses 3 --dist worksteal

# The whole of every test matrix, and what of the code no test runs.
test-full: check
	$(BIN)/pytest --numprocesses 2 --dist worksteal --cov --cov-report=term-missing:skip-covered

# SIGKILL at random moments of runs and of what resumes them; SEED=n repeats the moments of an earlier session.
test-kill: $(TESTED)
	$(BIN)/python -m tests.kills.run --trials $(TRIALS) $(if $(SEED),--seed $(SEED))

# Whoever is killed or stopped while the laser emits: how soon it is dark, by its own answer, and who made it so.
test-light: $(TESTED)
	$(BIN)/python -m tests.kills.light --trials $(TRIALS) $(if $(SEED),--seed $(SEED))

# Drivers nobody here wrote, in an environment of their own, against `labctl sim serve`.
interop: $(TESTED) $(INTEROP)/.installed
	LABCTL=$(abspath $(BIN)/labctl) $(INTEROP)/bin/pytest -c tests/interop/interop.ini --rootdir=. --confcutdir=tests/interop \
		tests/interop tests/instruments/test_vendor_tree.py

# The virtual Tektronix instruments against the manufacturer's descriptions; every difference is listed with its reason.
truth: $(TESTED) $(INTEROP)/.installed
	LABCTL=$(abspath $(BIN)/labctl) $(INTEROP)/bin/python -m tests.truth

# The documents as a site; a warning, a link that leads nowhere and an example that prints something else are errors.
# Figures and the small run of the examples are measured anew, in docs/made. The dashboard is photographed with Chromium;
# where there is none, the page says that its pictures are missing.
docs: $(INSTALLED) $(DOCS)
	$(BIN)/sphinx-build --quiet --fail-on-warning --jobs auto --fresh-env --doctree-dir build/docs/doctrees --builder html docs build/docs/html
	$(BIN)/sphinx-build --quiet --fail-on-warning --doctree-dir build/docs/doctrees --builder doctest docs build/docs/doctest
	$(BIN)/sphinx-build --quiet --fail-on-warning --doctree-dir build/docs/doctrees --builder linkcheck docs build/docs/linkcheck

# The picture in the README, which is kept so that it is seen where nothing was built.
picture: $(INSTALLED)
	rm -rf build/demo
	$(BIN)/labctl demo --out build/demo
	cp build/demo/*-twin-1/figures/accuracy.png docs/accuracy.png

fuzz: $(TESTED)
	$(BIN)/python -m tests.fuzz.run --minutes $(MINUTES)

# Known vulnerabilities of what the lock files pin and of what is installed; "Error 3" means that it could not be checked.
audit: $(TESTED)
	$(BIN)/python -m tests.audit $(AUDIT) $(LOCKS)

check: $(TESTED) $(IMAGING)
	$(BIN)/ruff format --check --quiet $(SOURCES)
	$(BIN)/ruff check --quiet $(SOURCES)
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(TESTED)
	$(BIN)/ruff format $(SOURCES)
	$(BIN)/ruff check --fix $(SOURCES)

COMPILE = $(VENV)-lock/bin/pip-compile --quiet --generate-hashes --strip-extras --allow-unsafe --no-emit-index-url \
	--no-emit-find-links --no-emit-trusted-host --no-emit-options --no-header
HARDWARE := --extra alp --extra dlpc900 --extra serial --extra usb

lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/pip install --quiet pip-tools
	$(COMPILE) --extra build --extra dev --extra docs --output-file requirements-docs.lock pyproject.toml
	$(COMPILE) --extra build --extra dev --constraint requirements-docs.lock --output-file requirements-dev.lock pyproject.toml
	$(COMPILE) --extra build --constraint requirements-dev.lock --output-file requirements.lock pyproject.toml
	$(COMPILE) --extra build $(HARDWARE) --constraint requirements-dev.lock --output-file requirements-hardware.lock pyproject.toml
	$(COMPILE) --constraint requirements-dev.lock --output-file requirements-imaging.lock requirements-imaging.in
	$(COMPILE) --output-file requirements-interop.lock requirements-interop.in
	rm -rf $(VENV)-lock

clean:
	rm -rf $(VENV) $(INTEROP) build docs/made .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis .coverage*

$(INSTALLED): requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(PIP) --require-hashes --requirement requirements.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	touch $@

$(TESTED): requirements-dev.lock $(INSTALLED)
	$(PIP) --require-hashes --requirement requirements-dev.lock
	touch $@

# torch, for the tests of the extra `imaging` and their types; the demo does without. Its wheels differ from index to
# index (CPU or CUDA), so it alone is pinned without a hash, and what a CUDA wheel needs beyond the lock comes with it.
$(IMAGING): requirements-imaging.lock requirements-torch.txt $(TESTED)
	$(PIP) --require-hashes --requirement requirements-imaging.lock
	$(PIP) --requirement requirements-torch.txt
	touch $@

$(DOCS): requirements-docs.lock $(INSTALLED)
	$(PIP) --require-hashes --requirement requirements-docs.lock
	touch $@

$(INTEROP)/.installed: requirements-interop.lock
	$(PYTHON) -m venv $(INTEROP)
	$(INTEROP)/bin/pip install --quiet --disable-pip-version-check --require-hashes --requirement requirements-interop.lock
	touch $@
