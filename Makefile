PYTHON ?= python3
BIN := .venv/bin
RUNNING := .venv/.installed-dashboard
WORKING := .venv/.installed-dev
FAST := $(addprefix tests/shared/,bus fusion matching ros scales search)
# Python caches its bytecode, whatever the machine's default: tests start many processes.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

ROLES := router featurizer describer channel fuser verifier replay
DOCKERFILE := deploy/docker/Dockerfile

.PHONY: demo test test-fast lint docs audit bench images

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

# Needs Docker with buildx. BUILD_FLAGS may name a cache. Each image is run once; none is pushed.
images:
	for role in $(ROLES); do \
	  docker buildx build --file $(DOCKERFILE) --target $$role --tag placefield-$$role --load $(BUILD_FLAGS) . \
	  && docker run --rm --entrypoint placefield placefield-$$role --version || exit; \
	done

.venv/.installed-%: pyproject.toml
	@echo "Installing Placefield and what '$*' takes into .venv; this takes some minutes."
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --upgrade pip
	$(BIN)/pip install --editable '.[$*]'
	touch $@
