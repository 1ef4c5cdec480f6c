"""An excitation of a few seconds, for tests that do not depend on the motion."""

import re
from pathlib import Path

from aerarm_ros.description.resources import resource


def quick(folder: Path, **parameters: object) -> dict[str, object]:
    """Return parameters of the excitation node; its excitation_config is written to a directory."""
    config = folder / 'excitation.yaml'
    text = resource('config', 'excitation.yaml').read_text()
    config.write_text(re.sub('ramp_time: [0-9.]+', 'ramp_time: 0.8', text))
    return {
        'fundamental': 0.5,
        'harmonics': 2,
        'amplitude': 0.2,
        'periods': 1,
        'wait_timeout': 60,
        'state_timeout': 10.0,  # a shared machine may pause
        'excitation_config': config,
        **parameters,
    }
