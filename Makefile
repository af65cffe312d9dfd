PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed

.PHONY: demo test lint docs audit bench

demo: $(INSTALLED)
	$(BIN)/placefield demo $(if $(REF),"$(REF)" "$(QUERY)")

test: $(INSTALLED)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile

lint: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(INSTALLED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

audit: $(INSTALLED)
	$(BIN)/pip-audit --local --skip-editable --format json 2>/dev/null | $(PYTHON) .ci/audit

bench: $(INSTALLED)
	for part in match features build chain scale; do $(BIN)/placefield bench $$part || exit; done

$(INSTALLED): pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --editable '.[dev]'
	touch $@
