.DEFAULT_GOAL := help
.PHONY: help set-up demo test test-slow test-all test-mpi test-wheels test-kernels test-faults figures pictures docs lint clean

# Debian's dolfinx belongs to this interpreter; the first python3 on the path may be another one.
PYTHON := /usr/bin/python3
VENV := .venv
# An interpreter of Python 3.12 or later, for the environment with PyPI's wheels.
WHEELS_PYTHON := python3
WHEELS_VENV := .venv-wheels
LINT_VENV := .venv-lint
# Pinned, so that a new release of a linter cannot fail an old commit.
LINTERS := ruff==0.17.5 mypy==2.4.1
# More arguments for pytest: make test ARGS='-k film'
ARGS :=
# Processes for the tests; whole files each, as those share what is slow to make.
WORKERS := auto
ON_ALL_CORES = -n $(WORKERS) --dist loadfile
# Ranks that wait for each other shall fail, not hang.
MPI_TIME_LIMIT := 900

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*  ## /\1\t/p' $(MAKEFILE_LIST) | expand -t 14

set-up: $(VENV)/stamp  ## install what is missing

demo: set-up  ## run the slider-crank into results/slider-crank
	$(VENV)/bin/fenics-ehd run slider-crank --overwrite -o results/slider-crank

test: set-up  ## run the fast tests
	$(VENV)/bin/python -m pytest $(ON_ALL_CORES) $(ARGS)

test-slow: set-up  ## run the slow tests
	$(VENV)/bin/python -m pytest $(ON_ALL_CORES) -m slow $(ARGS)

test-all: set-up  ## run fast and slow tests
	$(VENV)/bin/python -m pytest $(ON_ALL_CORES) -m "" $(ARGS)

# Containers run as root and may offer one core, both of which Open MPI refuses unless told; MPICH of
# PyPI's wheels has no switches for that. Rank 1 writes to a file, or its lines would cut through
# those of rank 0.
define test_on_two_ranks
@rm -f $(1)/rank-1.log
PATH="$(CURDIR)/$(1)/bin:$$PATH" timeout $(MPI_TIME_LIMIT) mpirun -n 2 sh -c ' \
  test "$${OMPI_COMM_WORLD_RANK:-$$PMI_RANK}" = 0 || exec > $(1)/rank-1.log 2>&1; \
  exec $(1)/bin/python -m pytest -m mpi -p no:cacheprovider --color=no \
    $$(grep -l mark.mpi tests/test_*.py) $(ARGS)' \
|| { status=$$?; cat $(1)/rank-1.log; exit $$status; }
endef

test-mpi test-wheels: export OMPI_ALLOW_RUN_AS_ROOT := 1
test-mpi test-wheels: export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
test-mpi test-wheels: export OMPI_MCA_rmaps_base_oversubscribe := 1
test-mpi test-wheels: export PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe
test-mpi test-wheels: export OMP_NUM_THREADS := 1
test-mpi test-wheels: export OPENBLAS_NUM_THREADS := 1
test-mpi: set-up  ## run the parallel tests on 2 ranks
	$(call test_on_two_ranks,$(VENV))

# The installed copy is tested, not the checkout: what the package forgot to ship fails here.
test-wheels: export PYTHONSAFEPATH := 1
test-wheels: $(WHEELS_VENV)/stamp  ## fast tests, tests on 2 ranks and the demo with PyPI's wheels
	$(WHEELS_VENV)/bin/pip install --quiet --disable-pip-version-check --no-deps .
	rm -rf build/lib build/bdist.*
	$(WHEELS_VENV)/bin/python -m pytest $(ON_ALL_CORES) $(ARGS)
	$(call test_on_two_ranks,$(WHEELS_VENV))
	$(WHEELS_VENV)/bin/fenics-ehd run slider-crank --overwrite -o build/wheels-demo

test-kernels: set-up  ## run the numeric tests on every BLAS kernel this processor has
	$(VENV)/bin/python tests/kernels.py $(ARGS)

test-faults: export OMP_NUM_THREADS := 1
test-faults: export OPENBLAS_NUM_THREADS := 1
test-faults: set-up  ## malformed inputs, kills, full disks, errors on one rank
	$(VENV)/bin/python tests/faults $(ARGS)

figures: set-up $(VENV)/exudyn $(VENV)/ross/stamp $(VENV)/pynastran/stamp  ## run the tests whose numbers the validation page shows
	$(VENV)/bin/python tests/ross_case.py --python $(VENV)/ross/bin/python -o tests/golden/ross.json
	$(VENV)/bin/python tests/pynastran_case.py --python $(VENV)/pynastran/bin/python
	PYTHONPATH=$(VENV)/exudyn $(VENV)/bin/python -m pytest -m "" --figures=docs/validation.json tests $(ARGS)
	$(VENV)/bin/python docs/tables.py

pictures: set-up  ## draw the pictures of docs/pictures again
	mkdir -p build
	$(VENV)/bin/fenics-ehd run slider-crank --no-plots --overwrite -o build/slider-crank
	$(VENV)/bin/fenics-ehd plot build/slider-crank -o docs/pictures $(addprefix --quantity big_end.,\
	  min_film_thickness orbit force pressure_map film_map bore)
	$(VENV)/bin/fenics-ehd run four-bar --no-plots --overwrite -o build/linkage
	sed 's/^viscosity = 0.05/viscosity = 0.04/' build/linkage/scene.toml > build/thinner.toml
	$(VENV)/bin/fenics-ehd run build/thinner.toml --no-plots --overwrite -o build/thinner
	$(VENV)/bin/fenics-ehd plot build/linkage build/thinner --difference \
	  --quantity rocker_end.min_film_thickness -o docs/pictures
	$(VENV)/bin/python docs/demo_pictures.py
	rm -f docs/pictures/*.svg

docs: set-up $(VENV)/docs-stamp  ## build the documentation site into build/site
	$(VENV)/bin/python -m sphinx -q -W --keep-going docs build/site

lint: set-up $(LINT_VENV)/stamp  ## ruff, mypy, and the rules of the house: layers, sizes, words
	$(LINT_VENV)/bin/ruff check .
	$(LINT_VENV)/bin/ruff format --check .
	$(LINT_VENV)/bin/mypy --python-executable $(VENV)/bin/python
	$(VENV)/bin/python tests/lint_house.py

clean:  ## remove the environments and everything built, but no results
	rm -rf $(VENV) $(LINT_VENV) $(WHEELS_VENV) build *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Install what a list of packages names and the system lacks, or say how.
define install
missing=; for package in $$(sed 's/#.*//' $(1)); do \
  dpkg-query -Wf '$${db:Status-Status}' $$package 2>/dev/null | grep -q ^installed \
    || missing="$$missing $$package"; \
done; \
if [ -z "$$missing" ]; then :; \
elif [ "$$(id -u)" = 0 ]; then \
  apt-get update && \
  DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $$missing; \
else \
  echo "sudo apt-get update && sudo apt-get install --no-install-recommends$$missing" >&2; exit 1; \
fi
endef

$(VENV)/stamp: pyproject.toml debian-packages.txt
	@command -v dpkg-query >/dev/null || { \
	  echo "no Debian packages here: python3 -m venv ehd && ehd/bin/pip install '.[wheels]' installs" \
	    "PyPI's libraries (Python 3.12 or later), or use the Dockerfile, see docs/installation.md" >&2; exit 1; }
	@$(call install,debian-packages.txt)
	$(PYTHON) -m venv --clear --system-site-packages $(VENV)
	$(VENV)/bin/pip install --quiet --disable-pip-version-check \
	  --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/docs-stamp: $(VENV)/stamp debian-packages-docs.txt
	@$(call install,debian-packages-docs.txt)
	@touch $@

# For .ci/run: tests that need these packages are skipped without them.
$(VENV)/tests-stamp: $(VENV)/stamp debian-packages-tests.txt
	@$(call install,debian-packages-tests.txt)
	@touch $@

# Beside Debian's packages, so that pip cannot replace numpy; the program does without it.
$(VENV)/exudyn: $(VENV)/stamp
	$(VENV)/bin/pip install --quiet --disable-pip-version-check --no-deps --target $@ exudyn==1.13.6

# Without system packages, as it needs newer ones; matrices are handed over as a file. Later plotly
# lacks what this release imports.
$(VENV)/ross/stamp: $(VENV)/stamp
	$(PYTHON) -m venv --clear $(@D)
	$(@D)/bin/pip install --quiet --disable-pip-version-check ross-rotordynamics==2.3.0 'plotly<6'
	@touch $@

# Without system packages, as it needs older ones.
$(VENV)/pynastran/stamp: $(VENV)/stamp
	$(PYTHON) -m venv --clear $(@D)
	$(@D)/bin/pip install --quiet --disable-pip-version-check pyNastran==1.4.1
	@touch $@

# Without system packages: libraries of Debian and of PyPI are never mixed.
$(WHEELS_VENV)/stamp: pyproject.toml
	$(WHEELS_PYTHON) -m venv --clear $(WHEELS_VENV)
	$(WHEELS_VENV)/bin/pip install --quiet --disable-pip-version-check '.[wheels]' \
	  pytest pytest-xdist hypothesis setuptools wheel
	@touch $@

# Linters import nothing of ours, so they may come from PyPI.
$(LINT_VENV)/stamp: Makefile
	$(PYTHON) -m venv --clear $(LINT_VENV)
	$(LINT_VENV)/bin/pip install --quiet --disable-pip-version-check $(LINTERS)
	@touch $@
