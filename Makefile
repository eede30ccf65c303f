# texsss: `make demo` bakes and renders the default scene, `make test` runs every test, `make serve` opens
# the page. All make the environment first; nothing but Python 3.11 and make is needed.
PYTHON ?= python3
# Name an index of PyTorch's CPU wheels here if yours does not offer them: make TORCH_INDEX=URL
TORCH_INDEX ?=
PIP := .venv/bin/pip --disable-pip-version-check
INDEX := $(if $(TORCH_INDEX),--extra-index-url $(TORCH_INDEX))

PAGE := $(shell find web -name node_modules -prune -o -type f -print)

.PHONY: demo test serve page check format bench clean
.DELETE_ON_ERROR:

demo: .venv
	.venv/bin/texsss bake --out out

test: .venv
	@$(MAKE) --no-print-directory page || { [ "$$CI" != true ] || exit 1; echo "THE PAGE COULD NOT BE BUILT (see above): its tests do not run."; }
	.venv/bin/python -m pytest $(ARGS)

serve: .venv page
	.venv/bin/texsss serve --log-format text

page: server/static/index.html

server/static/index.html: web/node_modules/.stamp $(PAGE)
	web/npm run --silent build

web/node_modules/.stamp: web/package.json web/package-lock.json | .venv
	web/npm ci --silent
	@touch $@

check: .venv
	.venv/bin/ruff format --check .
	.venv/bin/ruff check .
	.venv/bin/pyright

format: .venv
	.venv/bin/ruff format .
	.venv/bin/ruff check --fix .

bench: .venv
	.venv/bin/python -m benchmarks

.venv: .venv/.stamp

# torch comes first and alone, so that no other package pulls in a build of several gigabytes
.venv/.stamp: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "texsss needs Python 3.11 or newer: make PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "texsss needs Python's venv module: install the package python3-venv, then run make again."; exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP) install --quiet -c constraints.txt $(INDEX) torch
	$(PIP) install --quiet -c constraints.txt $(INDEX) -e '.[test,dev]'
	@touch $@

clean:
	rm -rf .venv out build dist *.egg-info server/static web/node_modules
