"""The names that `import aerarm_ros` offers exist, and are imported on first use."""

import subprocess
import sys

from source_files import ROOT

import aerarm_ros


def test_every_offered_name_resolves() -> None:
    assert aerarm_ros.__all__
    for name in aerarm_ros.__all__:
        assert getattr(aerarm_ros, name) is not None


def test_importing_the_package_imports_none_of_its_modules() -> None:
    script = "import aerarm_ros, sys; print(*(m for m in sys.modules if m.startswith('aerarm_')))"
    run = subprocess.run(
        [sys.executable, '-c', script], check=True, capture_output=True, text=True, cwd=ROOT
    )
    assert run.stdout.split() == ['aerarm_ros']
