# Everything that people, CI and the release do, by name: `make help`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
DEMO := demo
# One thread per process: the suite runs its processes side by side.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export PIP_DISABLE_PIP_VERSION_CHECK ?= 1
# Processes that tests start find the package compiled.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help install demo test acceptance freeze long bench check format samples figures docs build clean

help:  ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

# Not compiled: the demo imports a tenth of what is installed, and Python compiles that.
$(BIN)/uwtrack: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[plot]'
	@touch $@

$(VENV)/.development: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $(BIN)/uwtrack $@

install: $(VENV)/.development  ## make .venv with the development extra

demo: $(BIN)/uwtrack  ## run the chain on a sample and draw a picture
	$(BIN)/uwtrack sample pass --output $(DEMO) --overwrite
	$(BIN)/uwtrack run $(DEMO)/pass.wav --overwrite
	$(BIN)/uwtrack plot $(DEMO)/pass.run.h5 --output $(DEMO)/pass.png --overwrite

test: $(VENV)/.development  ## the suite: style, types, tests, doctests
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal

acceptance: $(VENV)/.development  ## slow tests, and what the program can do is as frozen: all parts, or PART="slow quiet lines"
	$(BIN)/python -m tests.acceptance check $(PART)

freeze: $(VENV)/.development  ## make what comes out now the frozen state: all parts, or PART=...
	$(BIN)/python -m tests.acceptance freeze $(PART)

long: $(VENV)/.development  ## the Monte-Carlo and stress runs that take long
	$(BIN)/python -m tests.acceptance long
	$(BIN)/python -m tests.acceptance faults
	$(BIN)/python -m pytest -m long --timeout 0

bench: $(VENV)/.development  ## speed as ratios and memory, with their figures
	$(BIN)/python -m pytest tests/benchmarks -m "benchmark and not long" -s

check: $(VENV)/.development  ## style and types only
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

format: $(VENV)/.development  ## put the code into the house style
	$(BIN)/ruff check --fix --quiet .
	$(BIN)/ruff format .

samples: $(VENV)/.development  ## make the sample recordings and tables again
	$(BIN)/python -c "from pathlib import Path; \
	from studies.sample_tables import write_sample_tables; \
	from uwtrack_cli.flow.sample_recordings import remake_samples; \
	remake_samples(Path('sample_data')); write_sample_tables(Path('sample_data'))"

figures: $(VENV)/.development  ## draw the pictures of README and docs again
	for name in auto vessel multi-resolution presence small-craft small-array towed-array vehicle weak-lines dense-clutter; do \
	$(BIN)/uwtrack recipes --graph $$name -o docs/recipes/$$name.svg --overwrite; done
	mkdir -p $(DEMO)
	$(BIN)/uwtrack run sample_data/propeller.wav --recipe presence -o $(DEMO)/propeller.run.h5 --overwrite
	ln -sf $(CURDIR)/sample_data/propeller.wav $(DEMO)/propeller.wav
	$(BIN)/uwtrack plot $(DEMO)/propeller.run.h5 -o docs/presence.png --overwrite
	$(BIN)/uwtrack plot $(DEMO)/propeller.run.h5 --demon -o docs/demon.png --overwrite
	$(BIN)/uwtrack sample pass --output $(DEMO) --overwrite
	$(BIN)/uwtrack run $(DEMO)/pass.wav --start-utc 2024-05-01T12:00:00Z --overwrite
	$(BIN)/uwtrack plot $(DEMO)/pass.run.h5 --passage 1 -o docs/pass.png --overwrite
	$(BIN)/uwtrack plot $(DEMO)/pass.run.h5 -o docs/recording.png --overwrite
	$(BIN)/uwtrack plot $(DEMO)/pass.run.h5 --passage 1 --size 3.35 5 --dpi 150 --no-title -o docs/column.png --overwrite
	$(BIN)/uwtrack plot $(DEMO)/pass.wav --band-hz 20 500 --db-range 40 --window-s 2 -o docs/sound.png --overwrite
	$(BIN)/uwtrack tma sample_data/bearings.csv --own-ship sample_data/own-ship.csv -o $(DEMO)/bearings.motions.h5 --overwrite
	$(BIN)/uwtrack plot $(DEMO)/bearings.motions.h5 -o docs/motion.png --overwrite
	$(BIN)/python -m tests.draws.fringe_picture docs/fringes.png
	if command -v chromium >/dev/null; then $(MAKE) docs && chromium --headless --no-sandbox \
	--hide-scrollbars --window-size=1280,1000 --screenshot=docs/site.png \
	"file://$(CURDIR)/docs/_build/html/soundtrap-folder.html"; fi

docs: $(VENV)/.development  ## the documentation site in docs/_build/html; a warning is an error
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

build: $(VENV)/.development  ## wheel and source distribution
	$(BIN)/python -m build

clean:  ## remove what was made
	rm -rf $(VENV) $(DEMO) dist build docs/_build docs/reference
