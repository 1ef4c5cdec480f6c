"""PX4 as a program on this host, configured for a drone."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import TracebackType

from aerarm_ros.autopilot.px4_setup import AIRFRAME, Px4Setup
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.arm_load import MassProperties

HOW = (
    "PX4 is missing: build it (make px4_sitl_default), then run 'make flight AUTOPILOT=px4 "
    "PX4=<folder of the build>'. The folder contains bin/px4 and etc"
)
_PROGRAM = 'bin/px4'
_ENDING = 5.0  # [s]
# Ends PX4 together with the process that starts it, because PX4 runs on without its simulator. The
# guard is a separate process, since code between fork and exec may hang with threads.
GUARD = """
import ctypes, os, signal, sys
parent = int(sys.argv[1])
ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)
if os.getppid() == parent:
    os.execv(sys.argv[2], sys.argv[2:])
"""


def find_px4() -> Path | None:
    """Return the folder of the build in the variable PX4, None if not set."""
    given = os.environ.get('PX4', '')
    places = [Path(given).expanduser() / part for part in ('', 'build/px4_sitl_default')]
    return next((place for place in places if given and (place / _PROGRAM).is_file()), None)


class Px4Program:
    """Context manager that runs PX4 in a separate folder, configured for a drone.

    Parameters
    ----------
    build : Path
        Folder of the PX4 build.
    folder : Path
        Folder of parameters and logs.
    drone : DroneConfig
        Configuration of the drone.
    body : MassProperties
        Mass properties of drone and arm at rest.
    setup : Px4Setup
        Settings of PX4.
    instance : int
        Instance number, which determines the ports.

    Attributes
    ----------
    log : Path
        Log file of its output.

    Raises
    ------
    ValueError
        If PX4 cannot fly the drone.
    """

    def __init__(
        self, build: Path, folder: Path, drone: DroneConfig, body: MassProperties,
        setup: Px4Setup, instance: int = 0,
    ) -> None:  # fmt: skip
        self._build, self._folder = build.resolve(), folder
        self._instance = instance
        self._parameters = setup.parameters(drone, body)
        self._process: subprocess.Popen[bytes] | None = None
        self.log = folder / 'px4.log'

    def __enter__(self) -> 'Px4Program':
        program = str(self._build / _PROGRAM)
        command = [program, '-d', '-i', str(self._instance), str(self._build / 'etc')]
        command += ['-w', str(self._folder)]
        guard = [sys.executable, '-c', GUARD, str(os.getpid())]
        environment = {
            **os.environ,
            'PATH': f'{self._build / "bin"}:{os.environ["PATH"]}',
            'PX4_SYS_AUTOSTART': AIRFRAME,
            'PX4_SIM_HOST_ADDR': '127.0.0.1',
            **{f'PX4_PARAM_{name}': f'{value:.7g}' for name, value in self._parameters.items()},
        }
        environment.pop('PX4_SIM_MODEL', None)
        with self.log.open('ab') as log:
            self._process = subprocess.Popen(
                [*guard, *command], cwd=self._folder, stdin=subprocess.DEVNULL, stdout=log,
                stderr=log, env=environment, start_new_session=True,
            )  # fmt: skip
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process is None:
            return
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    @property
    def pid(self) -> int:
        """Process id of PX4."""
        assert self._process is not None
        return self._process.pid
