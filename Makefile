# Everything that is done with this repository. `make help` lists it.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
RUNS   := $(VENV)/.runs
STAMP  := $(VENV)/.installed
# The same commit installs the same versions; `make lock` renews them. `make test-latest` leaves them out.
CONSTRAINTS ?= constraints.txt
INSTALL = $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile $(addprefix -c ,$(CONSTRAINTS))
# Compiling all 19 000 files of all packages takes as long as unpacking them; a run imports a fifth of them, and compiles those.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
TORCH = $(INSTALL) --no-deps --retries 2 --timeout 10 --index-url $(TORCH_INDEX) $$(grep -o 'torch==[0-9.]*' pyproject.toml) 2>/dev/null \
  || echo "nothing comes from $(TORCH_INDEX): PyTorch is taken from where pip looks, on Linux with CUDA, four gigabytes more"
# PyPI's PyTorch for Linux brings CUDA, which nothing here uses.

# Commands and tests start hundreds of processes: what one has compiled, the others read.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: $(shell grep -oE '^[a-z-]+:' $(MAKEFILE_LIST) | tr -d ':')

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'

setup: $(STAMP) ## create .venv, install the package with what development needs, look for the system's libraries

$(BIN)/python:
	@sh scripts/system_libraries.sh venv $(PYTHON)
	$(PYTHON) -m venv $(VENV)

$(RUNS): pyproject.toml $(CONSTRAINTS) scripts/system_libraries.sh | $(BIN)/python
	@echo "installing what a run needs into $(VENV) (OpenCV, MuJoCo, numba …): a minute or two, once"
	$(INSTALL) --editable .
	@sh scripts/system_libraries.sh egl
	@touch $@

$(STAMP): pyproject.toml $(CONSTRAINTS) scripts/system_libraries.sh | $(BIN)/python
	@echo "installing Pomona and what its tests, benchmarks and documentation need into $(VENV): a few minutes, once"
	@$(TORCH)
	$(INSTALL) --editable '.[dev]'
	@sh scripts/system_libraries.sh egl
	@touch $(RUNS)
	@$(BIN)/pomona run trees/pick_apple.yaml --no-record --quiet # compiles the loops once, not once in each test process
	@touch $@

run: $(RUNS) ## pick an apple on the simulated cell
	$(BIN)/pomona run trees/pick_apple.yaml

PYTEST = $(BIN)/python -m pytest -n 2 --dist worksteal
WHOLE = not realtime and not long

test: $(STAMP) ## run the quick tests and one whole pick (three minutes on two quiet cores)
	$(PYTEST) -n 3 --dist each -m '$(WHOLE) and (not slow or pick)' --durations 5 --durations-min 3 # each worker imports its own files alone
	@echo "left out: tests of 0.3 s of processor time and more; make test-slow, and make evidence-status for when each ran"

safety: $(STAMP) browser ## what can break safety: a fault row of each kind, a pick of each tree
	$(PYTEST) -m '$(WHOLE) and landmark and not pick' --durations 5 --durations-min 3

CORE = tests/executive tests/drivers tests/skills
LEAVES = executive/tools drivers/tools drivers/devices skills/tools skills/applications

test-core: $(STAMP) ## the same of the core alone: the executive, drivers and skills without the packages on top of them
	$(PYTEST) -m '$(WHOLE) and not slow' $(CORE) $(addprefix --ignore tests/,$(LEAVES))

test-times: $(STAMP) ## measure the processor time of each test, and write those of 0.3 s and more to tests/slow_tests.txt
	$(BIN)/python scripts/slow_tests.py

test-latest: ## the same with the newest allowed versions of everything, in an environment of its own (.venv-latest)
	rm -rf .venv-latest
	$(MAKE) VENV=.venv-latest CONSTRAINTS= test

test-slow: $(STAMP) ## the other slow ones: whole picks, the operator's page in a browser, tutorials (PART=tests/skills for some)
	@sh scripts/system_libraries.sh tests
	$(PYTEST) -m '$(WHOLE) and slow and not landmark' --durations 8 $(PART)

test-realtime: $(STAMP) ## the whole pick through emulated devices and wires; needs a machine with nothing else to do
	$(BIN)/python -m pytest -m realtime

test-long: $(STAMP) ## what takes half a minute or more each and is left out of the tests
	$(BIN)/python -m pytest -m long

lerobot-env: ## LeRobot in an environment of its own (it pins another torch), for its long test; gigabytes
	test -x .lerobot/bin/python || $(PYTHON) -m venv .lerobot
	.lerobot/bin/python -m pip install --quiet --disable-pip-version-check lerobot==0.4.4 lerobot-doctor==0.2.0

docs: $(STAMP) ## the documentation's site, in site/; a broken link is an error
	NO_MKDOCS_2_WARNING=1 DISABLE_MKDOCS_2_WARNING=true $(BIN)/python -m mkdocs build --strict

docs-serve: $(STAMP) ## the same, shown at http://127.0.0.1:8000 while it is written
	NO_MKDOCS_2_WARNING=1 DISABLE_MKDOCS_2_WARNING=true $(BIN)/python -m mkdocs serve

browser:
	@sh scripts/system_libraries.sh tests

check: test browser ## what CI runs: quick tests, then what can break safety beside types, lint and layers
	$(MAKE) --jobs 2 --output-sync=line safety static

static: types lint

evidence: $(STAMP) ## run long targets (NAMES="picks faults-sim"), and keep at which commit each passed
	$(BIN)/python scripts/evidence.py run $(NAMES)

evidence-status: $(STAMP) ## when each long target last passed, and whether what it judges has changed since (CHECK="--check safety")
	@$(BIN)/python scripts/evidence.py status $(CHECK)

without-leaves: $(STAMP) ## take each leaf out in turn, and run the rest (LEAF=tools/groot for one, FULL=--full for all its quick tests)
	$(BIN)/python scripts/without_leaves.py $(LEAF) $(FULL)

lint: $(STAMP) ## ruff, import contracts and the bounds of the whole
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/python scripts/size.py --check

size: $(STAMP) ## tokens of the house and of each room, beside bounds that only fall (SIZE=--lower)
	$(BIN)/python scripts/size.py $(SIZE)

walks: $(STAMP) ## the files that one tick, frame and wrench sample of a pick pass through (WALKS=--files: which)
	$(BIN)/python scripts/walks.py $(WALKS)

types: $(STAMP) ## mypy over everything
	$(BIN)/mypy

kit: $(STAMP) ## what `pomona new` writes, judged with a third party's tools
	$(BIN)/python scripts/check_kit.py

bench: $(STAMP) ## the 25 cells of the paper, one seed each, with times per skill
	rm -rf runs/campaign_pick
	$(BIN)/pomona campaign benchmarks/pick.yaml

paper: $(STAMP) ## the paper's experiment, its tables beside ours in runs/reports/paper; goes on where it was stopped
	$(BIN)/pomona campaign benchmarks/paper.yaml $(CAMPAIGN)
	$(BIN)/python -m benchmarks.paper_report benchmarks/paper.yaml runs/campaign_paper --out runs/reports/paper

paper-large: $(STAMP) ## the same with 40 randomised runs a cell; CAMPAIGN="--seeds 10 --workers 4" for a part, or elsewhere
	$(BIN)/pomona campaign benchmarks/paper_large.yaml $(CAMPAIGN)
	$(BIN)/python -m benchmarks.paper_report benchmarks/paper_large.yaml runs/campaign_paper_large --out runs/reports/paper_large

ablations: $(STAMP) ## refinement, planning and force beside their baselines, in docs/reports
	for part in refine planner force; do \
	  $(BIN)/pomona campaign benchmarks/ablation_$$part.yaml --report-to runs/reports/ablation_$$part $(CAMPAIGN) || exit 1; \
	done

bench-arms: $(STAMP) ## fifty picks on the emulated twin of a UR5e with a Hand-E, with force fingers and without
	$(BIN)/pomona campaign benchmarks/arms.yaml $(CAMPAIGN)

bench-tree: $(STAMP) ## the executive beside bare py_trees: ticks, recording, jitter, checking a large file
	$(BIN)/python -m benchmarks.bench_tree
	$(BIN)/python -m benchmarks.bench_runner

train-detect: $(STAMP) ## train the detector from nothing and replace the shipped weights (hours)
	$(BIN)/pomona train detect --out skills/pomona/skills/perception/detection/weights/apple.weights

bench-editor: $(STAMP) ## 10 000 random edits of tree files with their judge, and the time from an edit to its findings; EDITS=…
	$(BIN)/python -m benchmarks.bench_editor --edits $(or $(EDITS),10000)

bench-start: $(STAMP) ## what the small commands cost: --help, check, skills, show, export, runs list
	$(BIN)/python -m benchmarks.bench_start

bench-detect: $(STAMP) ## the detector on held-out rendered frames, and its speed beside DOPE's full network
	$(BIN)/python -m benchmarks.bench_detect

bench-refine: $(STAMP) ## refinement, both methods side by side
	$(BIN)/python -m benchmarks.bench_refine

bench-caliper: $(STAMP) ## a camera's error, noticed from drawn picks: false alarms, and picks until it is noticed
	$(BIN)/python -m benchmarks.bench_caliper

bench-plan: $(STAMP) ## planning over random scenes, beside the paper's way
	$(BIN)/python -m benchmarks.bench_plan

bench-watch: $(STAMP) ## a hand that comes into the way of the moving arm: 200 paths, and 100 on which nothing is new (half an hour)
	$(BIN)/python -m benchmarks.bench_watch

bench-moving: $(STAMP) ## fruit from a running belt, picked of accepted; SPEEDS="0.15 0.3", COUNT=200 fruit at each (hours)
	$(BIN)/python -m benchmarks.bench_moving --speeds $(or $(SPEEDS),0.15 0.3) --count $(or $(COUNT),200)

bench-grasp: $(STAMP) ## grip control over random lifts, baselines beside it
	$(BIN)/python -m benchmarks.bench_grasp --plots runs/bench_grasp

bench-record: $(STAMP) ## what recording costs, and how large a pick's record is
	$(BIN)/python -m benchmarks.bench_record

bench-dashboard: $(STAMP) ## what the dashboard costs and how quick it is
	$(BIN)/python -m benchmarks.bench_dashboard

screenshots: $(STAMP) ## pictures of the dashboard to look at, in runs/screenshots
	$(BIN)/python scripts/screenshots.py runs/screenshots

screens: $(STAMP) ## every state and every failure code at four sizes, measured whole; pictures in runs/screens
	mkdir -p runs/screens
	SCREENS=runs/screens $(BIN)/python -m pytest -p no:xdist tests/executive/tools/dashboard/test_reason.py tests/executive/tools/dashboard/test_states.py

figures: $(STAMP) ## the figures of docs/method.md, from what the code computes, and the pictures whose sources have changed
	$(BIN)/python -m scripts.figures
	$(BIN)/python -m scripts.pictures

notebooks: $(STAMP) ## the tutorials as executed notebooks beside their Markdown (NAMES="first_apple campaign" for some)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'nbclient>=0.11' 'ipykernel>=6.29'
	$(BIN)/python scripts/notebooks.py $(NAMES)

results: $(STAMP) ## docs/results.md, written from docs/results.json
	$(BIN)/python -m scripts.results

measured: $(STAMP) ## what a benchmark prints, kept with its commit in runs/reports/measured; NAME=refine COMMAND="make bench-refine"
	$(BIN)/python scripts/measured.py $(NAME) $(COMMAND)

coverage: $(STAMP) ## which lines the tests reach, by package; the whole in htmlcov (a quarter longer than the tests)
	@sh scripts/system_libraries.sh tests
	$(BIN)/python -m pytest -n 2 --dist worksteal --cov --cov-report=html --cov-report=term:skip-covered

mutate-map: $(STAMP) ## which quick test of the core reaches which line, for `make mutate` (half an hour; in parts with MUTATE="--seconds 280")
	$(BIN)/python scripts/mutate.py --map $(MUTATE)

mutate: $(STAMP) ## small mistakes anywhere in the core, and how many of them its quick tests find (an hour; MUTATE="--most 50 --seed 7")
	$(BIN)/python scripts/mutate.py $(MUTATE)

bench-devices: $(STAMP) ## streams and round trips of the device drivers on emulated devices
	$(BIN)/python -m benchmarks.bench_devices

bench-crate: $(STAMP) ## heaps and crates of fruit that touches, cleared of n with intervals; SEEDS=1..20 KINDS=heap5,crate6 (hours)
	$(BIN)/python -m benchmarks.bench_crate --seeds $(or $(SEEDS),1..20) $(if $(KINDS),--kinds $(KINDS))

bench-cures: $(STAMP) ## seeded failures of ten kinds and their smallest cures; EACH=5 failures of each kind (an hour)
	$(BIN)/python -m benchmarks.bench_cures --each $(or $(EACH),5)

oracle: $(STAMP) ## the collision model beside MuJoCo over 10 000 random states
	$(BIN)/python -m benchmarks.collision_oracle --states 10000

FAULT_CELLS = sim emulated emulated_ur5e_hand_e_fingers emulated_xarm6_hand_e_fingers emulated_plc conveyor

faults: $(STAMP) ## every fault in every phase of a pick, judged by the simulator's truth (CELL=sim for one cell)
ifdef CELL
	$(BIN)/python -m benchmarks.fault_matrix --cell $(CELL) $(if $(SEED),--seed $(SEED))
else
	for cell in $(FAULT_CELLS); do $(BIN)/python -m benchmarks.fault_matrix --cell $$cell || exit 1; done
	$(BIN)/python -m benchmarks.fault_matrix --cell sim_crate --seed 4
endif

fuzz: $(STAMP) ## a million each: damaged tree files, cell files, device streams, records, messages to and from the page; 100 000 random trees (three hours)
	$(BIN)/python tests/executive/language/fuzz.py --cases 1000000
	$(BIN)/python tests/executive/language/reference.py --trees 100000
	$(BIN)/python tests/drivers/cell/fuzz_cells.py --cases 1000000
	$(BIN)/python -m benchmarks.fuzz_codecs
	$(BIN)/python tests/executive/recording/fuzz_records.py records --cases 1000000
	$(BIN)/python tests/executive/recording/fuzz_records.py messages --cases 1000000

soak: $(STAMP) ## 1 000 simulated picks in one process: memory, handles, threads and ticks stay flat (hours)
	$(BIN)/python -m benchmarks.soak --picks 1000

kill-points: $(STAMP) ## 1 000 runs ended at random points with every signal (an hour or two)
	$(BIN)/python -m benchmarks.kill_points --points $(or $(POINTS),1000)

persons: $(STAMP) ## a person's hand at the tool: each phase, three ways, stays of 1, 3 and 8 s (half an hour)
	$(BIN)/python -m pytest -q -n 2 -m "" tests/end_to_end/test_after_a_person.py

sbom: $(STAMP) ## a bill of materials (CycloneDX) of what is installed in .venv, in sbom.cdx.json
	$(BIN)/python scripts/sbom.py sbom.cdx.json

lock: $(STAMP) ## renew constraints.txt (what make installs) and requirements.lock (a run's packages with their SHA-256)
	$(BIN)/python scripts/lock.py

release: $(STAMP) ## judge the repository, build wheel and sdist, try both in clean environments (RELEASE=--tag: tag them)
	$(BIN)/python scripts/release.py $(RELEASE)

container: ## the operator's page in a container, as a user without rights (docker or podman)
	$$(command -v podman || command -v docker) build -f Containerfile -t pomona .

clean: ## remove the virtual environment and caches (records in runs/ stay)
	find executive skills drivers -name __pycache__ -prune -exec rm -rf {} +
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache *.egg-info
