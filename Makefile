# make demo: everything once on the shipped scene      make test: lint, types, tests
# On Windows without make, see README.md, "Two commands".
PYTHON ?= python3
ENV := .venv
BIN := $(ENV)/bin
READY := $(ENV)/.ready

.PHONY: demo test format bench clean

demo: $(READY)
	$(BIN)/hapscene demo --out out/demo

test: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(READY)
	$(BIN)/hapscene bench --out out/bench

$(READY): pyproject.toml requirements.lock
	$(PYTHON) -m venv $(ENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c requirements.lock -e ".[dev,step]"
	touch $(READY)

clean:
	rm -rf $(ENV) out
