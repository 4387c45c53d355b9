# make grasp   mesh the tutorial's finger and let the gripper grasp; the results are in out/grasp
# make test    ruff and mypy, then every test
# make bench   time the engine on this machine; the results are in out/bench. OPTIONS=--quick is passed on
# make scoreboard  friction: problems of FCLIB and Siconos in the folder DATA=...
# make site    the documents as a site in out/site, which opens from the disk
# make wheel   the packages to publish, with the kernels' machine code, in out/wheel
# make reduced the shipped reduced models in data/reduced; what they are made by is in out/reduced
# make clean   remove what these made
#
# All first install what they need into .venv; `make grasp` has no need of the tools of `make test`.
# PYTHON=/path/to/python chooses the interpreter.

.PHONY: grasp test bench scoreboard site wheel reduced lint kernels clean system-libraries browser

grasp: system-libraries
	mkdir -p out/grasp
	.venv/bin/taichisoft mesh tutorial --set mesh.largest=10 --set mesh.smallest=10 --output out/grasp/finger.msh
	.venv/bin/taichisoft run gripper --controller scripted --outputs recording,metrics,pictures,video,report \
	    --video out/grasp/grasp.mp4 --set soft_bodies.finger1.mesh=out/grasp/finger.msh --output out/grasp

# A process a core, four at most. Each has half of the tests in their order, because those of a file share what is
# expensive, and takes from the others when it is done. The kernels are compiled once for all.
test: system-libraries browser .venv/test-tools
	$(MAKE) --no-print-directory --jobs 2 lint kernels
	.venv/bin/pytest --numprocesses logical --maxprocesses 4 --dist worksteal --durations 25 --durations-min 5

kernels: system-libraries
	.venv/bin/python -c 'from taichisoft.runtime.machine_code import compile_package; compile_package()'

bench: system-libraries .venv/test-tools
	.venv/bin/python -m taichisoft_benchmarks --output out/bench $(OPTIONS)

scoreboard: system-libraries .venv/test-tools
	.venv/bin/python -m taichisoft_benchmarks.friction_problems $(DATA)

site: .venv/test-tools
	.venv/bin/sphinx-build --quiet --fail-on-warning --keep-going -c docs/site . out/site
	@echo "open out/site/index.html"

wheel: .venv/test-tools
	.venv/bin/python -c 'from taichisoft.runtime.compiler import ship; ship()'
	.venv/bin/python -m build --outdir out/wheel

reduced: system-libraries
	.venv/bin/taichisoft reduce gripper -o out/reduced/gripper
	.venv/bin/taichisoft reduce cable-gripper -o out/reduced/cable-gripper
	.venv/bin/taichisoft reduce finger-inflated -o out/reduced/finger-inflated --range finger.cavity=0:75
	for scene in gripper cable-gripper finger-inflated; do \
	    install -D --mode 644 --target-directory data/reduced/$$scene out/reduced/$$scene/*.npz || exit; \
	done

lint: .venv/test-tools
	.venv/bin/ruff check
	.venv/bin/ruff format --check
	.venv/bin/mypy

clean:
	rm -rf .venv out

# Debian and Ubuntu split ensurepip from Python, so that a python3 of the right version may still not do.
right_version = import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
fits = import ensurepip; $(right_version)
pythons = $(or $(PYTHON),python3.12 python3.11 python3.13 python3)

pip_install = .venv/bin/python -m pip install --disable-pip-version-check --editable

# The stamps are written last and go before anything changes: an install that was cut short starts again, the first
# in an empty .venv.
.venv/installed: pyproject.toml
	@test -e $@ && exit; \
	for python in $(pythons); do \
	    $$python -c '$(fits)' 2>/dev/null && exec $$python -m venv --clear .venv; \
	done; \
	test -z '$(PYTHON)' && command -v uv >/dev/null && rm -rf .venv && exec uv venv --seed --python 3.12 .venv; \
	for python in $(pythons); do \
	    $$python -c '$(right_version)' 2>/dev/null || continue; \
	    echo "error: $$python lacks venv; on Debian and Ubuntu: sudo apt-get install python3-venv" >&2; exit 1; \
	done; \
	echo "error: needs Python 3.11, 3.12 or 3.13, and none of $(pythons) is one; with uv installed" \
	    "(https://docs.astral.sh/uv) Python 3.12 is fetched" >&2; \
	exit 1
	@rm -f $@
	$(pip_install) .
	@touch $@

.venv/test-tools: .venv/installed
	@rm -f $@
	$(pip_install) '.[test]'
	@touch $@

# The wheels of Taichi, gmsh and Open3D bring no X11 or OpenGL. To import the three takes seconds, to load
# the libraries themselves milliseconds.
define missing_packages
import ctypes, sys
from taichisoft_outputs.system_libraries import SYSTEM_LIBRARIES

for library in SYSTEM_LIBRARIES if sys.platform == "linux" else ():
    try:
        ctypes.CDLL(library.file or None)
    except OSError:
        print(library.package)
endef
export missing_packages

system-libraries: .venv/installed
	@missing=$$(.venv/bin/python -c "$$missing_packages") || exit; \
	test -n "$$missing" || exit 0; \
	install="apt-get install -y --no-install-recommends $$(echo $$missing)"; \
	if test $$(id -u) = 0; then sudo=; elif sudo -n true 2>/dev/null; then sudo='sudo -n'; \
	else echo "error: missing system libraries; run: sudo apt-get update && sudo $$install" >&2; exit 1; fi; \
	set -x; $$sudo apt-get update && DEBIAN_FRONTEND=noninteractive $$sudo $$install

# The test of the web page drives Chromium by playwright, whose own node.js needs libatomic. Without the two it is
# skipped, so that this must not fail.
browser: .venv/installed
	@missing=; .venv/bin/python -c 'import ctypes; ctypes.CDLL("libatomic.so.1")' 2>/dev/null || missing=libatomic1; \
	for name in chromium chromium-browser google-chrome; do command -v $$name >/dev/null && break; done \
	|| missing="$$missing chromium"; \
	test -n "$$missing" || exit 0; \
	if test $$(id -u) = 0; then sudo=; elif sudo -n true 2>/dev/null; then sudo='sudo -n'; else sudo=false; fi; \
	{ $$sudo apt-get update && DEBIAN_FRONTEND=noninteractive \
	$$sudo apt-get install -y --no-install-recommends $$missing; } >/dev/null 2>&1 || \
	echo "note: the test of the web page in a browser is skipped; for it run: sudo apt-get install $$missing"
