# Everything on a fresh clone with Python 3.11 or newer, a C/C++ compiler and make.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
SOURCES := $(shell find src control/src simulator studies motors parts -type f -not -name '*.pyc') \
	CMakeLists.txt pyproject.toml README.md

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# where `cogless live` looks for the engine of its pages
WEB_CACHE := $(or $(XDG_CACHE_HOME),$(HOME)/.cache)/cogless
# packages are byte-compiled when first imported; to rewrite a test's asserts again takes each worker 7 s
export PYTHONDONTWRITEBYTECODE =

.PHONY: help build demo test web axe hash lint control cppcheck misra pil proof reproof fuzz mutants keep same docs bench dist versions clean

help: ## what there is to make
	@sed -n 's/^\([a-z]*\):.*## /  make \1\t/p' $(MAKEFILE_LIST) | expand -t 18

$(VENV)/tools: pyproject.toml
	@test -n "$(PYTHON)" || { echo "cogless needs Python 3.11 or newer; none found (set PYTHON=...)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(PIP) nanobind scikit-build-core $(foreach tool,cmake ninja,$(if $(shell command -v $(tool)),,$(tool)))
	touch $@

$(VENV)/dependencies: $(VENV)/tools
	$(PIP) $$($(BIN)/python -c 'import tomllib; \
	  print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")')
	touch $@

# without optimising across files, for which a change of one C file costs half a minute; make dist has it
$(VENV)/wheel $(VENV)/wheel-single: $(VENV)/tools $(SOURCES)
	rm -rf $@
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-build-isolation --no-deps --wheel-dir $@ \
	  --config-settings=cmake.define.COGLESS_IPO=OFF \
	  --config-settings=cmake.define.COGLESS_DOUBLE_ENGINE=$(if $(filter %-single,$@),OFF,ON) .

$(VENV)/installed $(VENV)/installed-single: $(VENV)/tools $(SOURCES)
	@echo "Installing cogless: the first time it compiles for a minute"
	@$(MAKE) --no-print-directory -j2 $(VENV)/dependencies $(subst installed,wheel,$@)
	$(PIP) --no-deps --force-reinstall $(subst installed,wheel,$@)/*.whl
	@# byte code for later starts, as an environment may forbid them to write it: each would take a second longer
	$(BIN)/python -m compileall -q $(VENV)/lib/python*/site-packages/cogless
	$(BIN)/cogless design uomodri > /dev/null
	$(BIN)/cogless design mandra2019 > /dev/null
	touch $@

# what an extra needs, by the wheel that is installed: nothing is compiled for it
$(VENV)/extra-%: $(VENV)/tools | $(VENV)/installed
	$(PIP) "$$(echo $(VENV)/wheel/*.whl)[$*]"
	touch $@

build: $(VENV)/installed ## cogless in .venv

# its laws compute in single precision: the engine in double, half of the compiling, is left to `make build`
demo: $(or $(wildcard $(VENV)/installed),$(VENV)/installed-single) ## the main job: a motor that cogs, under five controllers
	$(BIN)/cogless run uomodri -o results/uomodri

test: $(VENV)/installed $(VENV)/extra-test ## the whole test suite
	$(BIN)/python -m pytest -q -n 2 --dist loadfile

web: $(VENV)/installed $(VENV)/extra-web ## the engine for live pages, as WebAssembly; compiled once, by ziglang
	$(BIN)/python -c 'from cogless.live.engine import module; module("single"), module("double")'

axe: ## axe-core from npm: with it, the tests look for pages that are hard to use
	npm install --silent --no-save --prefix build/axe axe-core@4

hash: $(VENV)/installed $(VENV)/extra-test $(VENV)/extra-pil ## a trace has the same bits by each compiler, -O2 and -O3, glibc and musl
	$(BIN)/python -m pytest -q -n 2 --dist worksteal -m compilers

lint: $(VENV)/installed $(VENV)/extra-lint ## ruff, mypy, and which room imports which
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

control: $(VENV)/tools ## the C library alone, float and double, with sanitizers
	for real in OFF ON; do \
	  export PATH="$(CURDIR)/$(BIN):$$PATH" && cmake -S control -B build/control-double-$$real -DCOGLESS_DOUBLE=$$real -DCOGLESS_SANITIZE=ON \
	    -DCMAKE_BUILD_TYPE=Debug && \
	  cmake --build build/control-double-$$real && \
	  ctest --test-dir build/control-double-$$real --output-on-failure || exit 1; \
	done

cppcheck: ## the C library by cppcheck
	cppcheck --quiet --std=c99 --enable=warning,style,performance,portability --inline-suppr --error-exitcode=1 \
	  -I control/src control/src

misra: ## MISRA C:2012 by cppcheck's addon; control/MISRA.md has the deviations
	rm -rf build/misra && mkdir -p build/misra # its dumps: beside the sources `make dist` would pack them
	cppcheck --quiet --std=c99 --addon=misra --suppressions-list=control/misra.txt --error-exitcode=1 \
	  --cppcheck-build-dir=build/misra -I control/src control/src

pil: $(VENV)/installed $(VENV)/extra-pil ## every law on an emulated Cortex-M4F, against the simulation; its table in the docs
	$(BIN)/python docs/pil_tables.py --write

proof: ## Frama-C/Eva: no undefined behaviour, outputs within their limits; LAWS="foc pi" for some
	python3 control/proof/run.py --jobs 2 $(LAWS)

reproof: ## of proof what has changed since it was green
	python3 control/proof/run.py --jobs 2 --stale $(LAWS)

RUNS ?= 20000
fuzz: ## libFuzzer on the map loader and whole controllers; RUNS=10000000 for long
	control/fuzz/run.sh $(RUNS) 2

SEED ?= 1
N ?= 60
JOBS ?= 2
mutants: $(VENV)/installed $(VENV)/extra-test $(VENV)/extra-pil ## faults in the code that tests should notice; SEED=2 N=20 ROOM=simulator for others
	PYTHONPATH=tests $(BIN)/python -m mutants --seed $(SEED) --count $(N) --jobs $(JOBS) $(ROOM)

keep same: $(VENV)/installed
keep: ## keeps all outputs of the shipped studies, for `make same`
	$(BIN)/python tests/same.py keep --jobs $(JOBS)
same: ## shows which outputs differ from those that `make keep` kept
	$(BIN)/python tests/same.py compare --jobs $(JOBS)

docs: $(VENV)/installed $(VENV)/extra-docs ## the guide as HTML in docs/_build
	$(BIN)/python -m sphinx -W -q -b html docs docs/_build

bench: $(VENV)/installed ## speed, beside a hand-written loop and other simulators
	$(BIN)/python benchmarks/run.py

dist: $(VENV)/tools ## sdist and wheel in build/dist, installed and used in a clean environment
	$(PIP) build 'ziglang>=0.13'
	rm -rf build/dist build/clean
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python -m build --no-isolation --outdir build/dist \
	  --config-setting=cmake.define.COGLESS_WEB=ON --config-setting=cmake.define.COGLESS_WEB_CACHE='$(WEB_CACHE)' .
	$(PYTHON) -m venv build/clean
	build/clean/bin/python -m pip install --quiet --disable-pip-version-check --no-compile build/dist/*.whl
	cd build/clean && bin/cogless design liu2018 && bin/cogless run uomodri --only slow/pi --set 'scenario.slow.duration=8 s' --live -o results

# what pyproject.toml asks for, each "at least" as "exactly"
LOWEST = $(BIN)/python -c 'import tomllib; \
	  print(*(line.replace(">=", "==") for line in tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"]))'

# runs, designs and identifies; make dist runs with the newest versions
versions: $(VENV)/installed ## the oldest dependencies that pyproject.toml allows do the main jobs
	$(PYTHON) -m venv --clear build/versions
	build/versions/bin/python -m pip install --quiet --disable-pip-version-check --no-compile $$($(LOWEST))
	build/versions/bin/python -m pip install --quiet --disable-pip-version-check --no-compile --no-deps $(VENV)/wheel/*.whl
	cd build/versions && bin/cogless run uomodri --only slow/pi --set 'scenario.slow.duration=8 s' --plots -o run && \
	  bin/cogless design liu2018 && bin/cogless identify --plan $(CURDIR)/examples/my_motor.toml -o plan && \
	  bin/cogless run plan/study.toml --no-limits -o logs && bin/cogless identify logs/traces.nc --config plan/id.toml -o identified

clean: ## all that was built
	rm -rf build $(VENV) docs/_build
