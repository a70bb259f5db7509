# make demo: the main job on the shipped scene      make test: lint, types, tests      make docs: the web site
# make floors: what depends most on other libraries, with the lowest versions of them that are allowed
# make mutants: would a test notice? MUTANTS="--room contact --count 40" says where and how many
# Each makes the environment .venv the first time and reuses it later; PYTHON=python3.12 chooses the interpreter.
# On Windows without make, see README.md, "Two commands".
PYTHON ?= python3
ENV := .venv
BIN := $(ENV)/bin
READY := $(ENV)/.ready

.PHONY: demo test floors mutants format bench docs system clean

demo: $(READY)
	$(BIN)/hapscene demo --out out/demo

test: $(READY) system
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest --numprocesses auto --dist loadfile --reruns 1 -rR

# In an environment of its own, which is removed; three minutes on two cores. The lowest versions have wheels for the
# lowest Python alone.
FLOORS := tests/scene tests/surface tests/contact tests/exchange tests/test_recording.py \
	tests/capture/test_recording_file.py tests/capture/test_record_file.py \
	tests/study/test_staircase.py tests/study/test_statistics.py

floors:
	@if $(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then \
		bash .ci/versions $(PYTHON) lowest -- $(FLOORS); \
	else \
		echo "floors: tried with Python 3.11 alone, this is $$($(PYTHON) -V)"; \
	fi

mutants: $(READY)
	$(BIN)/python tests/mutants.py $(MUTANTS)

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(READY)
	$(BIN)/hapscene bench --out out/bench

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	@echo "out/site/index.html; search wants it served: $(BIN)/python -m http.server --directory out/site"

# System packages for scene.png, where they are missing and may be installed; harmless elsewhere.
system:
	@sh .ci/system-packages
	@sh .ci/node-packages

$(READY): pyproject.toml setup.py requirements.lock
	@echo "making the environment $(ENV), once; this takes a minute or two"
	$(PYTHON) -m venv $(ENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ".[dev,step]"
	@touch $(READY)

clean:
	rm -rf $(ENV) out
