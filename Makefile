# Each target does all the set-up that it needs, in .venv.

PYTHON ?= python3
T ?= tests/unit tests/integration
LONG := tests/system tests/faults
A ?=
# Most tests wait for other processes, so that four at once keep two cores busy.
JOBS ?= 4
PYTEST = $(BIN)/python -m pytest -n $(JOBS) --dist worksteal
PORT ?= 9092
DIST ?= dist
TOPICS ?=
ENGINE ?= docker

BIN := .venv/bin
READY := .venv/ready
JAZZY := .venv-jazzy/ready
BUILD := --build-constraints requirements.lock
VERSION = $(shell sed -n "s/^__version__ = '\(.*\)'$$/\1/p" src/ros2_kafka_bridge/__init__.py)
SYFT = SYFT_CHECK_FOR_APP_UPDATE=false SYFT_FILE_METADATA_SELECTION=none syft scan \
	--exclude '**/testing/pom.xml' --exclude '**/*.exe' --source-name ros2-kafka-bridge --source-version $(VERSION)
LOCK := $(BIN)/uv pip compile pyproject.toml --all-extras --group dev --universal \
	--python-version 3.11 --generate-hashes --no-header --quiet

# A sourced ROS 2 must not mix with the ROS 2 wheels in .venv.
# Tests start hundreds of processes, which would compile all their Python each time.
unexport PYTHONDONTWRITEBYTECODE
unexport PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH RMW_IMPLEMENTATION
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE

# pip trusts what the machine trusts, a company's authority for instance; uv only when told.
export UV_SYSTEM_CERTS ?= true

export ROS2_KAFKA_BRIDGE_KAFKA_JARS ?= $(CURDIR)/.kafka/jars

.PHONY: help setup demo warehouse test test-long test-all jars check lint format types locked kafka
.PHONY: bench experiment faults soak fuzz churn routes dist image version release docs site lock java
.DEFAULT_GOAL := help

help: ## what there is to make
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(READY) ## .venv with the locked dependencies and this project

demo: $(READY) ## orders through Kafka and ROS 2 and back, with Python alone (A='--seconds 60')
	@$(BIN)/ros2-kafka-bridge demo $(A)

warehouse: $(READY) ## orders, robots and a live page: a whole warehouse (A='--robots 30', A=--help)
	@$(BIN)/ros2-kafka-warehouse run --orders-per-minute 5 $(A)

test: $(if $(filter-out tests/unit%,$(T)),jars) $(if $(filter $(LONG:=%) tests,$(T)),$(JAZZY)) $(READY) ## what a change must pass (some: T=tests/unit, A='-k name')
	$(PYTEST) $(T) $(A)

test-long: jars $(JAZZY) $(READY) ## the long tests: the whole system, faults, properties at random
	$(PYTEST) $(LONG) $(A); long=$$?; \
	$(PYTEST) tests/unit tests/system -m hypothesis --hypothesis-profile=random $(A) && exit $$long

test-all: test test-long ## both

check: lint format types locked ## what must hold before a commit: lint, format, types, lock

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/zizmor --quiet --offline --persona=auditor --strict-collection .github

format: $(READY)
	$(BIN)/ruff format --check

types: $(READY)
	$(BIN)/mypy

# A copy, because uv keeps the versions that its output file names already.
locked: $(READY)
	@cp requirements.lock .venv/requirements.lock
	@$(LOCK) --output-file .venv/requirements.lock > .venv/lock.log
	@diff requirements.lock .venv/requirements.lock > .venv/lock.diff || \
		{ echo 'requirements.lock is not what pyproject.toml asks for: make lock' >&2; exit 1; }
	@! grep -n '://' requirements.lock || \
		{ echo 'requirements.lock must not name the place it was made with' >&2; exit 1; }
	@echo 'requirements.lock is in date'

kafka: java $(READY) ## a real one-node Kafka in the foreground (PORT=9092)
	@$(BIN)/python -m ros2_kafka_bridge.testing.local_kafka --port $(PORT) \
		$(if $(TOPICS),--topics $(TOPICS)) $(A)

bench: java $(READY) ## drain a topic both ways, latency, convert messages, plan a warehouse: side by side
	$(BIN)/python -m benchmarks.drain $(A)
	$(BIN)/python -m benchmarks.latency
	$(BIN)/python -m benchmarks.formats
	$(BIN)/ros2-kafka-warehouse benchmark

experiment: java $(READY) ## the paper's experiment, repeated and widened: half an hour, a report
	$(BIN)/python -m benchmarks.experiment $(A)

faults: java $(READY) ## numbered orders both ways while everything breaks at random (A='--seed 1')
	$(BIN)/python -m benchmarks.faults $(A)

soak: java $(READY) ## both ways at half the maximum rate for 10 minutes: memory, threads, files
	$(BIN)/python -m benchmarks.soak $(A)

fuzz: java $(READY) ## hostile records: decoders under atheris for 90 s, a million through a bridge
	$(BIN)/python -m benchmarks.fuzz_decoders --seconds 90
	$(BIN)/python -m benchmarks.fuzz $(A)

churn: java $(READY) ## subscribers that come and go 1,000 times
	$(BIN)/python -m benchmarks.churn $(A)

routes: java $(READY) ## 200 routes in one bridge: start-up, memory, threads
	$(BIN)/python -m benchmarks.routes $(A)

dist: $(READY) ## sdist, and the wheel that is built from it, to be installed elsewhere (DIST=dist)
	@rm -f $(DIST)/ros2_kafka_bridge-*
	@$(BIN)/uv build $(BUILD) --require-hashes --quiet --out-dir $(DIST)
	@ls $(DIST)/ros2_kafka_bridge-*

image: ## the image that Containerfile describes (ENGINE=podman, A='--build-arg BASE=...')
	$(ENGINE) build --file Containerfile --tag ros2-kafka-bridge --tag ros2-kafka-bridge:$(VERSION) \
		--label org.opencontainers.image.version=$(VERSION) $(A) .

version: $(READY) ## the files say the version that is to be released (V=0.2.0)
	@$(BIN)/python tools/releasing.py --cut '$(V)'
	@$(BIN)/python tools/make_docs.py

# The wheel asks for ranges: its SBOM has what its extras bring in the versions of the lock, and
# nothing of where it was made.
release: $(READY) ## of a tag: all that is published, into release/ (A=... of the image)
	@$(BIN)/python tools/releasing.py $(ENGINE) syft
	@$(ENGINE) info > /dev/null
	@rm -rf release .release .venv-release
	@$(MAKE) --no-print-directory dist DIST=.release
	@$(MAKE) --no-print-directory image
	@$(BIN)/uv venv --quiet --python $(BIN)/python .venv-release
	@$(BIN)/uv pip install --quiet --python .venv-release --constraints requirements.lock \
		--requirements pyproject.toml --all-extras .release/*.whl
	@rm .venv-release/lib/python*/site-packages/ros2_kafka_bridge-*.dist-info/direct_url.json
	@$(SYFT) dir:.venv-release -o cyclonedx-json=.release/ros2-kafka-bridge-$(VERSION).cdx.json
	@image=.release/ros2-kafka-bridge-$(VERSION)-image-$$($(ENGINE) image inspect \
		--format '{{.Architecture}}' ros2-kafka-bridge:$(VERSION)) && \
	$(ENGINE) save --output $$image.tar ros2-kafka-bridge:latest ros2-kafka-bridge:$(VERSION) && \
	$(SYFT) docker-archive:$$image.tar -o cyclonedx-json=$$image.cdx.json && gzip -n $$image.tar
	@chmod a+r .release/* && rm -rf .venv-release
	@cd .release && sha256sum * > SHA256SUMS
	@mv .release release && cat release/SHA256SUMS

docs: $(READY) ## the tables in docs, from the code, and the version where it is repeated
	$(BIN)/python tools/make_docs.py $(A)

site: $(READY) ## the documentation as pages to read and search in, into site/
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet --site-dir site $(A)
	@echo 'Look at it: python3 -m http.server --bind 127.0.0.1 --directory site 8000'

lock: $(READY) ## requirements.lock, after a change of pyproject.toml
	$(LOCK) --output-file requirements.lock > .venv/lock.log
	$(BIN)/uv pip compile requirements-jazzy.in --python-version 3.11 \
		--universal --generate-hashes --no-header --quiet --no-annotate \
		--output-file requirements-jazzy.lock > .venv/lock.log

# The older ROS 2 that the bridge is tested on, too.
$(JAZZY): requirements-jazzy.lock $(READY)
	@echo 'Setting up .venv-jazzy ...'
	@$(PYTHON) -m venv --clear .venv-jazzy
	@$(BIN)/uv pip install --quiet --python .venv-jazzy/bin/python --require-hashes -r $<
	@$(BIN)/uv pip install --quiet --python .venv-jazzy/bin/python --no-deps $(BUILD) --editable .
	@touch $@

# pip is asked once, for uv, with the hashes of the lock. Always into an empty .venv: the wheels
# of ROS 2 hold the metadata of a second package, which `uv pip sync` would remove with its files.
$(READY): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo 'Python 3.11 or newer is needed: make PYTHON=/path/to/python3' >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2> /dev/null || \
		{ echo 'Python can make no virtual environments here: install python3-venv' >&2; exit 1; }
	@echo 'Setting up .venv ...'
	@$(PYTHON) -m venv --clear .venv
	@awk '/^[a-z]/ {found = /^uv==/} found' requirements.lock > .venv/uv.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r .venv/uv.txt
	@$(BIN)/uv pip install --quiet --python $(BIN)/python --require-hashes -r requirements.lock
	@$(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps $(BUILD) --editable .
	@touch $@

# Once for all, before the tests that need them begin at the same time.
jars: java $(READY)
	@$(BIN)/python -c 'from ros2_kafka_bridge.testing.local_kafka import install_kafka; install_kafka()'

java:
	@"$${JAVA_HOME:+$$JAVA_HOME/bin/}java" -version 2>&1 | \
		grep -Eq 'version "(1[7-9]|[2-9][0-9])' || \
		{ echo 'Java 17 or newer is needed, to run Apache Kafka' >&2; exit 1; }
	@command -v mvn > /dev/null || \
		{ echo 'Maven (mvn) is needed, to fetch Apache Kafka' >&2; exit 1; }
