# Everything lives in .venv and build/; nothing is installed globally.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DOCS_STAMP := $(VENV)/.docs
PIPELINES := $(wildcard pipelines/*.yaml)
RUNS := $(patsubst pipelines/%.yaml,build/%/summary.json,$(PIPELINES))

.PHONY: help setup demo test lint docs bench bench-full bench-peers consumers pipelines models sweep-galileo clean \
	example-slew example-linkage example-spinup
.DELETE_ON_ERROR:

help: ## show the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

setup: $(STAMP) ## make .venv and install cmsreduce with its tools into it

$(STAMP): pyproject.toml
	@test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@$(BIN)/python -m compileall -q cmsreduce
	@$(BIN)/cmsreduce doctor --compile > /dev/null
	@touch $@

demo: $(STAMP) ## reduce the Galileo sample; the report is build/galileo/report.html
	$(BIN)/cmsreduce run pipelines/galileo.yaml

# Motion in time, docs/simulate.md; each prints and leaves build/example-*/motion.html.
example-slew: $(STAMP) ## slew of the Galileo sample, simulated in time
	$(BIN)/python examples/slew.py

example-linkage: $(STAMP) ## closed four-bar linkage with a flexible coupler
	$(BIN)/python examples/linkage.py

example-spinup: $(STAMP) ## spin-up of a flexible beam, with and without geometric stiffness
	$(BIN)/python examples/spinup.py

# One BLAS thread for each: two of them with two threads would wait for each other. Tests that stand together go to one
# process, which then sets up once what they share; the programs that tests start find their modules compiled.
# Tests write many small files, and wait for the disk at each of them: in memory where 8 GB are free.
TEST_FILES = $(shell [ "$$(df --output=avail /dev/shm 2>/dev/null | tail -n 1)" -gt 8000000 ] 2>/dev/null && echo /dev/shm || echo $${TMPDIR:-/tmp})

JOBS ?= 2
test: $(STAMP) ## all tests, two at a time; with more cores: make test JOBS=8
	TMPDIR=$(TEST_FILES) PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(JOBS) --dist worksteal

lint: $(STAMP) ## ruff, mypy, import contract
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(DOCS_STAMP) ## the documentation as a site, build/site/index.html; every link checked
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict -f docs/site/mkdocs.yml

$(DOCS_STAMP): $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

bench: $(STAMP) ## cmsreduce against scipy on small bodies, two minutes
	$(BIN)/python benchmarks/linear_algebra.py

bench-full: $(STAMP) bench-peers ## every peer on every body, and benchmarks/performance.md; hours
	$(BIN)/python benchmarks/reduction.py
	$(BIN)/python benchmarks/error_speed.py
	$(BIN)/python benchmarks/random_scenes.py
	$(BIN)/python benchmarks/corruptions.py
	$(BIN)/python benchmarks/linear_algebra.py --full --write

# Peers that would not share an environment with the project. Where one cannot be had, the tables say so.
bench-peers:
	-$(PYTHON) -m venv build/peers/exudyn && build/peers/exudyn/bin/pip install --quiet exudyn==1.13.6 scipy
	-$(PYTHON) -m venv build/peers/sdynpy && build/peers/sdynpy/bin/pip install --quiet sdynpy

# Nothing is downloaded: Exudyn is in the extra of that name, others are found by environment variables (benchmarks/consumers.md).
consumers: $(STAMP) ## scenes and files in the programs that are here, and benchmarks/consumers.md; minutes
	$(BIN)/python benchmarks/exported_scenes.py
	$(BIN)/python benchmarks/consumer_tests.py

pipelines: $(RUNS) ## run every pipeline whose inputs changed; try -j2

# A run depends on its pipeline, the fragments it may include, its sample's files and the code.
.SECONDEXPANSION:
build/%/summary.json: pipelines/%.yaml $$(wildcard configs/*.yaml) $$(wildcard sample_models/$$*/*) \
		$$(shell find cmsreduce -name "*.py") | $(STAMP)
	$(BIN)/cmsreduce run $< --out $(@D)

# 200 points; a broken limit (exit code 1) is a finding of a sweep, not a failure of it.
sweep-galileo: $(STAMP) ## error against speed of the Galileo sample: methods x cutoffs x orders x angles
	$(BIN)/cmsreduce sweep pipelines/galileo.yaml --set 'verify.compare={}' --out build/galileo-sweep --jobs 2 \
		--over reduce.method=craig-bampton,macneal-rubin,benfield-hruda,augmented \
		--over 'scene.articulation.spin=0 deg,90 deg' \
		--over reduce.cutoff=2,3,4,5,6 \
		--over balance.keep.fraction=0.1,0.01,1e-3,1e-4,1e-5 \
		|| test $$? -eq 1

models: $(STAMP) ## make the sample models again from their scripts
	$(foreach script,$(wildcard sample_models/*/make.py),$(BIN)/python $(script) &&) true

clean: ## remove build/
	rm -rf build

# One batch target per pipeline: `make run-galileo`.
$(patsubst pipelines/%.yaml,run-%,$(PIPELINES)): run-%: build/%/summary.json
.PHONY: $(patsubst pipelines/%.yaml,run-%,$(PIPELINES))
