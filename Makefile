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

.PHONY: check help setup develop demo experiment energy calibration flight world view test tests quick attacks same commissioning lint fuzz mutants compiled-test bench two-hosts docs pictures clean

help:
	@echo 'make demo        move the emulated arm, record, identify, validate, report'
	@echo 'make experiment  compare the controllers under a resting, a tilted and a moving drone'
	@echo 'make energy      energy of 100 random moves: planned, quintic and trapezoidal'
	@echo 'make flight      hover error caused by arm motion, per feed-forward, with a replay'
	@echo '                 (DRONES="hexarotor tilted_hexarotor": a drone with tilted rotors as well;'
	@echo '                 AUTOPILOT=px4 PX4=<folder of a build>, AUTOPILOT=ardupilot ARDUPILOT=<folder>'
	@echo '                 or AUTOPILOT=betaflight: flown by that firmware)'
	@echo 'make calibration tool error of emulated arms on held-out postures, nominal and calibrated'
	@echo 'make world       tool error in the world while wind moves the drone, with a replay'
	@echo 'make view        show the running arm in a browser'
	@echo 'make test        run lint, type check and all tests'
	@echo 'make attacks     run hundreds of attacks on the bridge in virtual time, print the worst results'
	@echo 'make same        compare motion, frames and figures with a stored record, byte for byte'
	@echo '                 (RECORD=1 writes the record; DATASETS=DIR adds the measured bags of that folder)'
	@echo 'make commissioning  commission emulated arms, correctly and wrongly assembled'
	@echo 'make fuzz        read 20,000 damaged and malicious bags'
	@echo 'make mutants     mutation testing of the code between a command and a motor'
	@echo 'make compiled-test  run the tests of the hardware package with the compiled cycle'
	@echo 'make two-hosts   simulate slow and lossy radios between drone and ground host, measure e-stops (root)'
	@echo 'make bench       run the benchmarks and compare with a baseline or another tool'
	@echo 'make docs        build the documentation site in output/docs'
	@echo 'make pictures    draw the graphs and the moving picture in docs/images (graphviz, chromium)'
	@echo 'make setup       install the requirements of all programs into $(VENV)'
	@echo 'make develop     make setup, plus the requirements of tests and benchmarks'
	@echo 'make clean       remove the files that make and the tests have written'

setup: $(VENV)/.ready

develop: $(VENV)/.developed

$(VENV)/.ready: setup.py pyproject.toml setup.cfg
	@$(PYTHON) -c 'import sys; v = "%d.%d" % sys.version_info[:2]; sys.exit(0 if v in "$(PYTHONS)".split() else "$(PYTHON) is Python " + v + ", but make needs $(PYTHONS)$(WHY): set PYTHON, for example make PYTHON=python3.12 ...")'
	@echo 'Installing into $(VENV) (only once, $(SIZE))'
	@# Made anew for another Python: one laid over the other is neither.
	@[ "$$($(BIN)/python -c '$(WHICH)' 2>&1)" = "$$($(PYTHON) -c '$(WHICH)')" ] || { rm -f $(VENV)/.developed $(VENV)/.documented; $(PYTHON) -m venv --clear $(VENV_FLAGS) $(VENV); }
	@$(PIP) --editable '.[$(EXTRAS)]'
	@$(BIN)/python -c 'import pinocchio' || { echo 'Pinocchio is missing: sudo apt install ros-jazzy-pinocchio (with ROS from apt)'; exit 1; }
	@$(PIP) --quiet 'spidev>=3.5,<4' || echo 'spidev was not built, so its tests are skipped: check that a C compiler and the Python headers are installed'
	@touch $@

$(VENV)/.developed: $(VENV)/.ready
	@echo 'Installing the requirements of tests and benchmarks (only once, $(MORE))'
	@$(PIP) --editable '.[$(EXTRAS),dev]'
	@touch $@

demo: setup
	$(BIN)/demo

experiment: setup
	$(BIN)/experiment

energy: setup
	$(BIN)/python benchmarks/energy.py --moves 100 --out output/energy

calibration: setup
	$(BIN)/python benchmarks/model_fits/calibration.py

flight: setup
	$(if $(filter-out px4 ardupilot betaflight,$(AUTOPILOT)),$(error AUTOPILOT=$(AUTOPILOT) is unknown: set px4, ardupilot or betaflight, or omit AUTOPILOT for flight_control))
	$(BIN)/python benchmarks/$(if $(AUTOPILOT),firmware.py --autopilot $(AUTOPILOT),flight.py) $(if $(DRONES),--drones $(DRONES)) --out output/flight

world: setup
	$(BIN)/python benchmarks/world.py --out output/world

view: setup
	$(BIN)/view

lint: develop
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Tests of pure modules: no process, no ROS, none that takes seconds.
QUICK := $(addprefix test/,description model motion simulation energy planner realtime pages parallel draft commissioning \
	autopilot excitation control hardware/gate hardware/frames hardware/boards architecture/test_imports.py docs/test_prose.py)
SLOW := $(addprefix --ignore=test/,control/base/test_free_base_estimator.py excitation/test_trajectory_designer.py)

check: develop
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target lint quick

quick: develop
	+$(BIN)/python -m pytest --quiet --numprocesses 2 $(SLOW) $(QUICK)

# Lint uses the time in which the tests wait. make prints the output of lint when lint ends.
test: develop
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target lint tests

tests: develop
	+$(BIN)/python -m pytest --numprocesses 3 --dist worksteal

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
