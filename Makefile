PYTHON ?= python3
BIN := .venv/bin
RUNNING := .venv/.installed-dashboard
WORKING := .venv/.installed-dev
FAST := $(addprefix tests/shared/,bus fusion matching ros scales search)
# Python caches its bytecode, whatever the machine's default: tests start many processes.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: demo test test-fast lint docs audit bench

demo: $(RUNNING)
	$(BIN)/placefield demo $(if $(REF),"$(REF)" "$(QUERY)")

test: $(WORKING)
	$(PYTEST) --durations=40 --durations-min=3

test-fast: $(WORKING)
	$(PYTEST) -m "not slow" $(FAST)

lint: $(WORKING)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(WORKING)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

audit: $(WORKING)
	$(BIN)/pip-audit --local --skip-editable --format json 2>/dev/null | $(PYTHON) .ci/audit

bench: $(WORKING)
	for part in match features build chain scale; do $(BIN)/placefield bench $$part || exit; done

.venv/.installed-%: pyproject.toml
	@echo "Installing Placefield and what '$*' takes into .venv; this takes some minutes."
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --upgrade pip
	$(BIN)/pip install --editable '.[$*]'
	touch $@
