"""Runner of another identification tool in a separate virtual environment."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ENVIRONMENTS = Path(os.environ.get('AERARM_PEERS', HERE.parents[2] / 'build' / 'peers'))
INSTALL_TIMEOUT, RUN_TIMEOUT = 900.0, 600.0  # [s]


@dataclass(frozen=True)
class Peer:
    """Requirements of another tool, and the script in this folder that uses it.

    The environment is created with pip on first use, in build/peers or the folder in AERARM_PEERS.

    Parameters
    ----------
    name : name in the table and of the environment.
    requirements : packages for pip.
    modules : modules that must be importable afterwards.
    script : file in this folder; its last line of output is JSON.
    library : C library required by pip's build, by its name for pkg-config; '' for none.
    library_package : Debian and Ubuntu package that contains the library.
    """

    name: str
    requirements: tuple[str, ...]
    modules: tuple[str, ...]
    script: str
    library: str = ''
    library_package: str = ''

    def run(self, *arguments: object) -> dict:
        """Return the script's result, or under 'skipped' the reason for its absence."""
        try:
            command = [self._python(), HERE / self.script, *arguments]
            done = subprocess.run(
                list(map(str, command)),
                check=True,
                capture_output=True,
                text=True,
                timeout=RUN_TIMEOUT,
            )
            return dict(json.loads(done.stdout.splitlines()[-1]))
        except subprocess.TimeoutExpired:
            return {'skipped': 'took too long'}
        except subprocess.CalledProcessError as error:
            missing = self._missing_packages() if 'pip' in error.cmd else []
            if missing:
                return {
                    'skipped': (f'not installed on this machine: apt install {" ".join(missing)}')
                }
            return {'skipped': _last_line(error)}

    def _python(self) -> Path:
        """Return the interpreter of the environment, creating it if missing."""
        folder = ENVIRONMENTS / self.name.replace(' ', '_').lower()
        python = folder / 'bin' / 'python'
        check = [str(python), '-c', f'import {", ".join(self.modules)}']
        if python.exists() and subprocess.run(check, capture_output=True).returncode == 0:
            return python
        subprocess.run([sys.executable, '-m', 'venv', str(folder)], check=True, capture_output=True)
        install = [str(python), '-m', 'pip', 'install', '--quiet', *self.requirements]
        subprocess.run(install, check=True, capture_output=True, timeout=INSTALL_TIMEOUT)
        subprocess.run(check, check=True, capture_output=True)
        return python

    def _missing_packages(self) -> list[str]:
        """Return the missing Debian packages that the library's build requires."""
        if not self.library:
            return []
        missing = []
        if shutil.which('cc') is None:
            missing.append('build-essential')
        if not Path(sysconfig.get_path('include'), 'Python.h').exists():
            missing.append('python3-dev')
        if shutil.which('pkg-config') is None:
            missing += ['pkg-config', self.library_package]
        elif subprocess.run(['pkg-config', '--exists', self.library]).returncode:
            missing.append(self.library_package)
        return missing


def _last_line(error: subprocess.CalledProcessError) -> str:
    output = error.stderr if isinstance(error.stderr, str) else (error.stderr or b'').decode()
    lines = [line for line in output.splitlines() if line.strip()]
    return lines[-1] if lines else str(error)
