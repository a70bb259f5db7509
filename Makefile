# make demo: the main job on the shipped scene      make test: lint, types and the fast tests, which gate a change
# make nightly: the slow tests (tests/nightly) and the floors      make docs: the web site
# make floors: what depends most on other libraries, with the lowest versions of them that are allowed
# make wheel: dist/hapscene-*.whl with compiled code for this platform, so that a first use need not compile
# make mutants: mutation testing; MUTANTS="--package contact --count 40" chooses the package and the number
# Each makes or completes the environment .venv the first time; PYTHON=python3.12 chooses the interpreter. PYTEST="..."
# adds options of pytest to `test` and `nightly`. On Windows without make, see CONTRIBUTING.md.
PYTHON ?= python3
PYTEST ?=
ENV := .venv
BIN := $(ENV)/bin

.PHONY: demo test nightly floors mutants format bench docs wheel system clean

demo: $(ENV)/.ready-demo
	$(BIN)/hapscene demo --out out/demo

# The warm-up compiles once what several processes of pytest would compile at the same time; types are checked meanwhile.
test: $(ENV)/.ready-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@$(BIN)/mypy & types=$$!; $(BIN)/hapscene lab warmup; compiled=$$?; wait $$types && exit $$compiled
	$(BIN)/pytest --numprocesses auto --dist loadfile $(PYTEST)

nightly: $(ENV)/.ready-nightly
	sh .ci/system-packages nightly
	$(BIN)/hapscene lab warmup
	$(BIN)/pytest --numprocesses auto --dist loadfile -m "soak or not soak" tests/nightly $(PYTEST)
	$(BIN)/pytest --numprocesses auto --dist loadfile -m "soak or nightly" --ignore tests/nightly tests $(PYTEST)
	$(MAKE) floors

# In an environment of its own, which is removed; three minutes on two cores. The lowest versions have wheels for the
# lowest Python alone.
FLOORS := tests/scene tests/surface tests/contact tests/exchange tests/render/test_recording.py \
	tests/capture/test_recording.py tests/capture/test_hsrec.py \
	tests/study/test_staircase.py tests/study/test_statistics.py

floors:
	@if $(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))'; then \
		bash .ci/versions $(PYTHON) lowest -- $(FLOORS); \
	else \
		echo "floors: tried with Python 3.11 alone, this is $$($(PYTHON) -V)"; \
	fi

mutants: $(ENV)/.ready-nightly
	$(BIN)/python tests/mutants.py $(MUTANTS)

format: $(ENV)/.ready-test
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(ENV)/.ready-nightly
	$(BIN)/hapscene lab bench --out out/bench

docs: $(ENV)/.ready-nightly
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	@echo "out/site/index.html; search wants it served: $(BIN)/python -m http.server --directory out/site"

wheel: $(ENV)/.ready-demo
	sh .ci/wheel $(BIN)/python dist

# System packages for pictures and for the gate's browser; `sh .ci/system-packages nightly` has the others.
system:
	@sh .ci/system-packages

EXTRAS-demo := step
EXTRAS-test := dev
EXTRAS-nightly := nightly

$(ENV)/.ready-%: pyproject.toml setup.py requirements.lock
	@sh .ci/install $(PYTHON) $(ENV) $(EXTRAS-$*)
	@touch $@

clean:
	rm -rf $(ENV) out
