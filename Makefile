# Everything a person, a hook or CI runs. `make` alone lists the targets.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
SHELL := bash

PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
export PATH := $(CURDIR)/$(BIN):$(HOME)/.cargo/bin:$(PATH)
export MUJOCO_GL ?= egl
unexport PYTHONDONTWRITEBYTECODE

# The one list of system packages: software OpenGL for headless rendering, and what OpenCV links against.
APT_PACKAGES := libegl1 libgl1 libgl1-mesa-dri libglib2.0-0 libosmesa6
RUST_SOURCES := Cargo.toml Cargo.lock $(shell find rust -name '*.rs' -o -name Cargo.toml)
WORKERS ?= 2
# lerobot 0.6 needs this Python; where uv cannot fetch one, give the path of one.
LEROBOT_PYTHON ?= 3.12
WHEEL_MACHINES := x86_64 $(shell rustup target list --installed 2>/dev/null | sed -n 's/^aarch64-unknown-linux-gnu$$/aarch64/p')

.PHONY: help setup system-libraries demo test test-rust test-python test-notebooks test-stubs test-wheel test-oldest test-lerobot wheel faults lint format docs bench bench-kernels fuzz clean

help: ## List the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 20

system-libraries: ## Install the OpenGL libraries if they are missing (needs root)
	@if ! ldconfig -p | grep -q libEGL.so.1 || ! ldconfig -p | grep -q libGL.so.1 \
	    || ! ldconfig -p | grep -q libOSMesa.so || ! ls /usr/lib/*/dri/swrast_dri.so >/dev/null 2>&1; then \
	  if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $(APT_PACKAGES); \
	  else \
	    echo "OpenGL libraries are missing. Run: sudo apt-get install $(APT_PACKAGES)" >&2; exit 1; \
	  fi; \
	fi

$(VENV)/.dependencies: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(BIN)/uv pip install --quiet --compile-bytecode --python $(BIN)/python --requirement pyproject.toml --extra dev
	@touch $@

$(VENV)/.package: $(VENV)/.dependencies $(RUST_SOURCES)
	$(BIN)/maturin develop --quiet --release --uv
	@touch $@

setup: system-libraries $(VENV)/.package ## Create .venv and build and install the package into it

demo: setup ## The whole job on a fresh machine: collect, train, transfer, report
	$(BIN)/ocplanner demo

test: setup test-rust test-python test-stubs test-wheel test-notebooks ## Every test

test-rust: ## Rust unit, property and doc tests
	@if cargo nextest --version >/dev/null 2>&1; then \
	  cargo nextest run --release --package ocplanner-core; \
	else \
	  echo "cargo-nextest is not installed (cargo install cargo-nextest): running cargo test instead"; \
	  cargo test --release --package ocplanner-core --lib --tests; \
	fi
	cargo test --release --doc --package ocplanner-core

test-python: setup ## Python unit, property, golden and end-to-end tests
	$(BIN)/pytest -n $(WORKERS) --dist worksteal

test-stubs: setup ## The hand-written _core.pyi against the built module
	$(BIN)/python -m mypy.stubtest ocplanner._core

test-notebooks: setup ## Run the notebooks on tiny data
	folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	  OCPLANNER_NOTEBOOK_TINY=1 OCPLANNER_NOTEBOOK_DATA=$$folder $(BIN)/pytest --nbmake --nbmake-timeout=600 notebooks

# Cheap: the release build is there already, and uv links packages from its cache.
target/wheels/newest: $(VENV)/.package $(shell find python -name '*.py' -o -name '*.j2') README.md
	rm -rf target/wheels
	$(BIN)/maturin build --release --quiet --out target/wheels
	ln -s "$$(basename target/wheels/*.whl)" $@

test-wheel: target/wheels/newest ## The wheel in an empty environment: the README's Python example runs
	$(BIN)/python tests/packaging/try_wheel.py "$$(realpath $<)"

test-oldest: target/wheels/newest ## The same with the oldest dependencies that pyproject.toml allows (downloads an old torch)
	$(BIN)/python tests/packaging/try_wheel.py "$$(realpath $<)" --oldest

# Apart, since lerobot and robosuite want different NumPys.
.venv-lerobot/.complete: $(VENV)/.dependencies
	$(BIN)/uv venv --quiet --allow-existing --python $(LEROBOT_PYTHON) .venv-lerobot
	$(BIN)/uv pip install --quiet --python .venv-lerobot/bin/python 'lerobot[dataset]==0.6.1'
	@touch $@

test-lerobot: setup .venv-lerobot/.complete ## Conversion to and from LeRobot's format, with lerobot in an environment of its own (5 GB)
	OCPLANNER_LEROBOT_PYTHON=$(CURDIR)/.venv-lerobot/bin/python $(BIN)/pytest tests/demos/test_lerobot.py

$(VENV)/.zig: $(VENV)/.dependencies
	$(BIN)/uv pip install --quiet --python $(BIN)/python 'ziglang>=0.13,<1'
	@touch $@

# zig links against the glibc of 2014, whatever this machine has.
wheel: setup $(VENV)/.zig ## The sdist, and wheels for Linux since 2014: x86-64, and aarch64 if rustup has that target; into dist
	rm -rf dist
	$(BIN)/maturin sdist --out dist
	for machine in $(WHEEL_MACHINES); do \
	  $(BIN)/maturin build --release --zig --compatibility manylinux2014 --target $$machine-unknown-linux-gnu --out dist || exit 1; \
	done

faults: setup ## Kill, fill and damage every verb some thousand times (half an hour and more); writes results/faults.json
	$(BIN)/python tests/faults/inject.py --output results/faults.json

lint: setup ## Formatting, lints, types and which room may import which, without changing anything
	cargo fmt --check
	cargo clippy --release --all-targets --quiet -- --deny warnings
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright
	$(BIN)/lint-imports

format: setup ## Format the sources and apply the safe lint fixes
	cargo fmt
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: setup ## The reference of the Python interface, from its docstrings, into dist/reference
	$(BIN)/python docs/reference.py dist/reference

$(VENV)/.peers: $(VENV)/.dependencies
	$(BIN)/uv pip install --quiet --python $(BIN)/python --requirement pyproject.toml --extra bench
	@touch $@

bench: setup $(VENV)/.peers ## Measure the engine against other runtimes, and control steps against robosuite; writes results/bench_*.json
	$(BIN)/python tests/benchmarks/bench_core.py --simd best avx2
	$(BIN)/python tests/benchmarks/bench_sim.py

bench-kernels: ## Time the Rust kernels one by one, on every instruction set of this processor (criterion)
	cargo bench --package ocplanner-benches

fuzz: setup ## Fuzz the native module for ten minutes; what fails is left in runs/fuzz
	$(BIN)/python tests/fuzz/fuzz_core.py --seconds 600

clean: ## Remove everything that is built
	rm -rf $(VENV) .venv-lerobot target dist python/ocplanner/_core*.so
