# `make help` lists what can be done. Nothing here writes outside the checkout.

PYTHON ?= python3
VENV ?= .venv
WORKERS ?= 2
ARGS ?=

BIN := $(VENV)/bin
STAMP := $(VENV)/.made-from-lock
UV := VIRTUAL_ENV=$(abspath $(VENV)) $(BIN)/uv

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help env example train smoke photos table1-photos table3-photos fewer-photos rendered-photos lifter shipped-lifter table1 table1-fit benchmark test test-all soak fuzz lint format lock asset docs docs-images clean

help:  ## Show this list.
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo
	@echo 'ARGS passes words on: make train ARGS="+experiment=ablation_row3", make test ARGS="-k camera".'

env: $(STAMP)  ## Make the environment: the exact locked packages, verified by hash.

example: $(STAMP)  ## Reconstruct the hands of two photographs; the page to open is named at the end.
	$(BIN)/hand-recon predict examples/hand.jpg examples/two_hands.jpg $(ARGS)

train: $(STAMP)  ## Train the default model, evaluate it and draw it; ARGS are Hydra overrides.
	$(BIN)/python -m hand_recon.train $(ARGS)

smoke: $(STAMP)  ## The same in about a minute, far too short to learn anything.
	$(BIN)/python -m hand_recon.train +experiment=smoke $(ARGS)

ROWS := ablation_row1,ablation_row2,ablation_row3,ablation_row4,ablation_row5
SEEDS ?= 0,1,2
# Runs at a time; each keeps to one thread.
RUNS ?= 2
AT_ONCE := hydra.launcher.n_jobs=$(RUNS)

# A folder of photographs of hands; with train.json (and test.json) in it, these are the labels.
PICTURES ?=
LABELS ?= outputs/labels/$(notdir $(patsubst %/,%,$(PICTURES)))
PHOTOS = photos.images=$(PICTURES) $(if $(wildcard $(PICTURES)/train.json),photos.train=$(PICTURES)/train.json,photos.train=$(LABELS)/labels.json) \
  $(if $(wildcard $(PICTURES)/test.json),photos.test=$(PICTURES)/test.json)

photos: $(STAMP)  ## Train a network that sees: PICTURES=<folder of photographs>, labelled first if they have no labels.
	@test -d "$(PICTURES)" || { echo "Name a folder of photographs of hands: make photos PICTURES=<folder>" >&2; exit 1; }
	test -e "$(PICTURES)/train.json" -o -e "$(LABELS)/labels.json" || $(BIN)/hand-recon prepare labels "$(PICTURES)" output="$(LABELS)"
	$(BIN)/python -m hand_recon.train recipe=photos name=photos $(PHOTOS) $(ARGS)

# All runs of a study of photographs are in one folder, which its report is about. With another paths.output in ARGS, the
# report needs it in REPORT_ARGS, too.
TIME := $(shell date +%Y-%m-%d_%H-%M-%S)
TRAIN_PHOTOS = @test -d "$(PICTURES)" || { echo "Name a folder of labelled photographs: make $@ PICTURES=<folder>" >&2; exit 1; }; \
  set -x; train() { $(BIN)/python -m hand_recon.train -m recipe=photos_table1 $(PHOTOS) 'hydra.sweep.dir=$${paths.output}/sweeps/$(TIME)' $(ARGS) "$$@"; };

table1-photos: $(STAMP)  ## The paper's Table 1 on photographs, PICTURES=<folder>: the same 15 minutes for each row, RUNS=2 at a time; then the report.
	$(TRAIN_PHOTOS) train +experiment=ablation_row1,ablation_row4,ablation_row5 seed=0,1 $(AT_ONCE) threads=1 && \
	  train +experiment=ablation_row2,ablation_row3 $(AT_ONCE) threads=1
	$(BIN)/python -m hand_recon.report $(REPORT_ARGS)

table3-photos: $(STAMP)  ## The paper's Table 3 (b) on photographs, PICTURES=<folder>: 3D labels of 0, 10 and 100 % of the rendered hands; then the report.
	$(TRAIN_PHOTOS) train supervision=landmarks_2d && train supervision=landmarks_3d supervision.fraction=0.1,1.0 $(AT_ONCE) threads=1 && \
	  train supervision=landmarks_3d prior=none
	$(BIN)/python -m hand_recon.report $(REPORT_ARGS)

# Fewer labels have fewer fingers to exchange, in the same proportion.
fewer-photos: $(STAMP)  ## How the error grows as labels shrink, with and without ImageNet weights, PICTURES=<folder>: 700, 3,000 and all photographs.
	$(TRAIN_PHOTOS) for size in 700:470 3000:2000 null:8000; do for weights in imagenet:4 none:0; do \
	  train trainer.max_epochs=2 photos.train_size=$${size%:*} photos.exchanged=$${size#*:} \
	    model.encoder.weights=$${weights%:*} model.encoder.frozen=$${weights#*:} || exit 1; done; done
	$(BIN)/python -m hand_recon.report 'method=[photos,data.parts.photographs,model.encoder]' $(REPORT_ARGS)

# Rendered hands alone: no photograph in an epoch.
FEATURES := null,[background],[objects],[sleeve],[light],[sensor],[skin_tones],[skin_texture],[nails]
rendered-photos: $(STAMP)  ## What of rendered hands matters for photographs, PICTURES=<folder>: trained on rendered hands alone that lack one feature each.
	$(TRAIN_PHOTOS) train trainer.max_epochs=2 data.weights.photographs=0 photos.exchanged=0 photos.rendered=8000 \
	  'data.parts.rendered.without=$(FEATURES)' $(AT_ONCE) threads=1
	$(BIN)/python -m hand_recon.report 'method=[data.parts.rendered]' $(REPORT_ARGS)

lifter: $(STAMP)  ## Train the lifter (2D landmarks to 3D hands) with all knowledge; minutes on one core.
	$(BIN)/python -m hand_recon.train recipe=lifter $(ARGS)

shipped-lifter: $(STAMP)  ## Train the lifter of the package again, from 2D alone (docs/lifter.md); no data are needed.
	OMP_NUM_THREADS=1 $(BIN)/python tools/build_lifter.py $(ARGS)

table1: $(STAMP)  ## The paper's Table 1 by training the lifter: five rows, three seeds, RUNS=2 at a time; then the report.
	$(BIN)/python -m hand_recon.train -m recipe=lifter +experiment=$(ROWS) seed=$(SEEDS) $(AT_ONCE) $(ARGS)
	$(BIN)/python -m hand_recon.report

table1-fit: $(STAMP)  ## The same by fitting 500 hands of each seed to noisy landmarks, without a network; two minutes.
	$(BIN)/python -m hand_recon.fit -m data=views +experiment=$(ROWS) seed=$(SEEDS) descent.finger_table=false lifter=none $(AT_ONCE) $(ARGS)
	$(BIN)/python -m hand_recon.report

benchmark: $(STAMP)  ## Speed as ratios to the published formulas, with a report: ARGS="suite=layer,physics".
	$(BIN)/python -m hand_recon.benchmark $(ARGS)

# pytest's processes are the parallelism: threads that share their cores only slow them down.
test test-all: export OMP_NUM_THREADS := 1

test: $(STAMP)  ## Run the tests that need no GPU, licence or dataset; ARGS go to pytest.
	$(BIN)/python -m pytest -n $(WORKERS) $(ARGS)

test-all: $(STAMP)  ## Run the slow tests too, and those for which GPU, MANO or datasets are there.
	$(BIN)/python -m pytest -n $(WORKERS) -m "" $(ARGS)

KILLS ?= 100

# Every part runs, also after one that failed.
SOAKS := "soak_resume.py --kills $(KILLS)" "soak_processes.py --kills 6" soak_sweeps.py \
  "soak_scale.py examples --images 24 --part 4 --kills 4 --rounds 0" "fuzz_readers.py --seconds 60"
soak: $(STAMP)  ## Kill trainings (KILLS=100 times), processes, sweeps and workers, continue them, and compare every bit; fuzz a minute.
	@failed=; for command in $(SOAKS); do echo "== tools/$$command"; \
	  OMP_NUM_THREADS=1 $(BIN)/python tools/$$command || failed="$$failed $${command%% *}"; done; \
	  test -z "$$failed" || { echo "Failed:$$failed" >&2; exit 1; }

FUZZ_SECONDS ?= 300

fuzz: $(STAMP)  ## Feed mutated files to every reader, FUZZ_SECONDS=300; findings are saved in outputs/fuzz.
	OMP_NUM_THREADS=1 $(BIN)/python tools/fuzz_readers.py --seconds $(FUZZ_SECONDS) $(ARGS)

lint: $(STAMP)  ## Check format, style, types, spelling, import direction and file sizes.
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/codespell
	$(BIN)/python tools/check_large_files.py

format: $(STAMP)  ## Format the code and mend what can be mended by machine.
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

lock: $(STAMP)  ## Lock again, keeping every version that still fits; ARGS=--upgrade for new ones.
	UV_CUSTOM_COMPILE_COMMAND="make lock" $(UV) pip compile pyproject.toml --extra dev --extra train --extra detect --extra backbone --extra heif --extra onnx --extra demo --extra fast --extra scale --extra shards --extra sweeps --extra docs --universal --python-version 3.11 --generate-hashes \
	  --no-emit-index-url --no-emit-find-links --quiet --output-file requirements.lock $(ARGS)

asset: $(STAMP)  ## Build the open hand again from its source (installs the assets extra).
	$(UV) pip install --constraints requirements.lock --requirements pyproject.toml --extra assets
	$(BIN)/python tools/build_open_hand.py

docs: $(STAMP)  ## Build the documents as a site in outputs/site; a broken link is an error.
	$(BIN)/python -m sphinx -q -W --keep-going -c docs/site -d outputs/site/.doctrees . outputs/site

docs-images: $(STAMP)  ## Draw the pictures of the open hand in docs/images again.
	$(BIN)/python tools/draw_open_hand.py

clean:  ## Remove the environment and the tools' caches; outputs, data and rendered hands stay.
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find hand_recon tests tools -name __pycache__ -type d -prune -exec rm -rf {} +

# uv itself comes from the lock, and everything else through uv: pip's settings on a machine, such as a
# folder of local wheels, cannot then put in another torch than the one that was locked.
$(STAMP): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo \
	  "hand_recon needs Python 3.11 or newer; '$(PYTHON)' is `$(PYTHON) --version 2>&1`." \
	  "Name a newer one: make PYTHON=python3.12 env" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' || { echo \
	  "'$(PYTHON)' cannot make virtual environments. On Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	awk '/^[^ ]/ { wanted = /^uv==/ } wanted' requirements.lock > $(VENV)/uv.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $(VENV)/uv.txt
	$(UV) pip install --compile-bytecode --require-hashes --build-constraints requirements.lock -r requirements.lock
	$(UV) pip install --no-deps --build-constraints requirements.lock --editable .
	@touch $@
