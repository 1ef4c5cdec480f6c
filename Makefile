# Two commands a newcomer needs: `make demo` and `make test`. Each sets up what it needs.

PYTHON ?= python3

# With a ROS 2 Jazzy environment sourced, its packages are used instead of the wheels, Pinocchio
# included (apt: ros-jazzy-pinocchio).
ifeq ($(ROS_DISTRO),jazzy)
VENV       ?= .venv-jazzy
VENV_FLAGS := --system-site-packages
EXTRAS     := view
PYTHONS    := 3.12
WHY        := , that of the sourced ROS 2 Jazzy
SIZE       := the Python packages that ROS does not bring
else
VENV       ?= .venv
VENV_FLAGS :=
EXTRAS     := ros,view
PYTHONS    := 3.11 3.12 3.13 3.14
WHY        :=
SIZE       := ROS 2 and Python packages, 0.25 GB to fetch, 1.1 GB on the disk
endif
MORE := 0.16 GB to fetch, 0.6 GB on the disk, most of it robots to test with
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install
# Which Python it is; for a virtual environment, of which it was made.
WHICH := import sys, venv; print(sys.base_prefix, sys.version)

# The ROS wheels' Fast DDS finds other processes in 80 ms with this profile (docs/decisions.md).
export FASTRTPS_DEFAULT_PROFILES_FILE ?= $(CURDIR)/config/fastdds.xml

.PHONY: help setup develop demo experiment energy calibration flight world view test attacks same commissioning lint fuzz mutants compiled-test bench two-hosts docs pictures clean

help:
	@echo 'make demo        move the emulated arm, record, identify, validate, report'
	@echo 'make experiment  the controllers, the drone still, tilted and moving'
	@echo 'make energy      100 random moves, planned for least energy beside quintics and trapezoids'
	@echo 'make flight      how far the arm moves its drone, by what is fed forward, with a replay'
	@echo '                 (DRONES="hexarotor tilted_hexarotor": one that pushes sideways, too;'
	@echo '                 AUTOPILOT=px4 PX4=<folder of a build> or AUTOPILOT=betaflight: that firmware flies it)'
	@echo 'make calibration tool error of emulated arms, as drawn and calibrated, on held-out postures'
	@echo 'make world       how well the tool is held in the world while wind moves the drone, with a replay'
	@echo 'make view        the running arm in a browser'
	@echo 'make test        lint, type check and all tests'
	@echo 'make attacks     hundreds of attacks on the bridge in virtual time, and their worst figures'
	@echo 'make same        compare motion, frames and figures with a stored record, byte for byte'
	@echo '                 (RECORD=1 writes the record; DATASETS=DIR adds the measured bags of that folder)'
	@echo 'make commissioning  emulated arms, healthy and wrongly assembled, through the guided procedure'
	@echo 'make fuzz        20,000 damaged and hostile bags'
	@echo 'make mutants     mutation testing of what stands between a command and a motor'
	@echo 'make compiled-test  the tests of the hardware room with the cycle as machine code'
	@echo 'make two-hosts   drone and ground as two hosts: slow and lossy radios, cuts, e-stop times (root)'
	@echo 'make bench       benchmarks beside a baseline or a peer'
	@echo 'make docs        the documentation site, into output/docs'
	@echo 'make pictures    the graphs and the moving picture in docs/images (graphviz, chromium)'
	@echo 'make setup       only install into $(VENV) what all of it needs but tests and benchmarks'
	@echo 'make develop     that, and what tests and benchmarks need'
	@echo 'make clean       remove what make and the tests leave'

setup: $(VENV)/.ready

develop: $(VENV)/.developed

$(VENV)/.ready: setup.py pyproject.toml setup.cfg
	@$(PYTHON) -c 'import sys; v = "%d.%d" % sys.version_info[:2]; sys.exit(0 if v in "$(PYTHONS)".split() else "$(PYTHON) is Python " + v + ", make takes $(PYTHONS)$(WHY): set PYTHON, as in make PYTHON=python3.12 ...")'
	@echo 'Installing into $(VENV), once: $(SIZE)'
	@# Made anew for another Python: one laid over the other is neither.
	@[ "$$($(BIN)/python -c '$(WHICH)' 2>&1)" = "$$($(PYTHON) -c '$(WHICH)')" ] || { rm -f $(VENV)/.developed $(VENV)/.documented; $(PYTHON) -m venv --clear $(VENV_FLAGS) $(VENV); }
	@$(PIP) --editable '.[$(EXTRAS)]'
	@$(BIN)/python -c 'import pinocchio' || { echo 'Pinocchio is missing: with the ROS of apt it comes from there, sudo apt install ros-jazzy-pinocchio'; exit 1; }
	@$(PIP) --quiet 'spidev>=3.5,<4' || echo 'spidev was not built (C compiler, Python headers?): its tests are skipped'
	@touch $@

$(VENV)/.developed: $(VENV)/.ready
	@echo 'Installing what tests and benchmarks need, once: $(MORE)'
	@$(PIP) --editable '.[$(EXTRAS),dev]'
	@touch $@

demo: setup
	$(BIN)/demo

experiment: setup
	$(BIN)/experiment

energy: setup
	$(BIN)/python benchmarks/energy.py --moves 100 --out output/energy

calibration: setup
	$(BIN)/python benchmarks/calibration.py

flight: setup
	$(if $(filter-out px4 betaflight,$(AUTOPILOT)),$(error AUTOPILOT=$(AUTOPILOT): px4 and betaflight are known; leave it out for the drone's own controller))
	$(BIN)/python benchmarks/$(or $(AUTOPILOT),flight).py $(if $(DRONES),--drones $(DRONES)) --out output/flight

world: setup
	$(BIN)/python benchmarks/world.py --out output/world

view: setup
	$(BIN)/view

lint: develop
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test: lint
	$(BIN)/python -m pytest --numprocesses 3 --dist worksteal

attacks: develop
	$(BIN)/python test/hardware/attack_campaign.py
	$(BIN)/python test/hardware/attack_campaign.py --runs 3 --lost-commands 0.1 0.2 0.3 0.5 0.7 0.8 0.9 0.95 1
	$(BIN)/python test/hardware/held_up_host.py

same: develop
	$(BIN)/python test/same/same.py $(if $(RECORD),--record) $(if $(DATASETS),--datasets '$(DATASETS)')

commissioning: develop
	$(BIN)/python test/commissioning/commissioning_campaign.py

fuzz: develop
	$(BIN)/python test/aerarm_msgs_py/bag_mutants/campaign.py

mutants: develop
	$(PIP) --quiet --editable '.[$(EXTRAS),dev,mutants]'
	$(BIN)/mutmut run
	$(BIN)/mutmut results

compiled-test: develop
	rm -rf build/compiled && mkdir -p build/compiled
	git ls-files -z | xargs -0 cp --parents --target-directory build/compiled
	cd build/compiled && AERARM_COMPILE=1 $(abspath $(BIN))/python setup.py --quiet build_ext --build-lib .
	cd build/compiled && PYTHONPATH=$$PWD $(abspath $(BIN))/python -c 'import aerarm_ros.hardware.bridge_cycle as cycle; assert cycle.__file__.endswith(".so"), cycle.__file__'
	cd build/compiled && PYTHONPATH=$$PWD $(abspath $(BIN))/python -m pytest test/hardware

bench: develop
	$(BIN)/python benchmarks/run.py

two-hosts: develop
	PYTHONPATH=$(CURDIR) $(BIN)/python benchmarks/two_hosts.py

docs: $(VENV)/.documented
	$(BIN)/python docs/generate_parameters.py >/dev/null
	$(BIN)/python -m sphinx -W --keep-going --quiet docs output/docs
	@echo 'file://$(CURDIR)/output/docs/index.html'

$(VENV)/.documented: $(VENV)/.ready
	@$(PIP) --quiet --editable '.[$(EXTRAS),docs]'
	@touch $@

pictures: setup
	for graph in docs/images/*.dot; do dot -Tsvg $$graph -o $${graph%.dot}.svg || exit 1; done
	$(BIN)/python docs/moving_picture.py

clean:
	rm -rf .venv .venv-jazzy build install log mutants output .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
