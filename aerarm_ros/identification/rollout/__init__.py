"""Models run by recorded torque alone: a second opinion, by positions.

In come samples of a motion and parameters; out goes how far the simulated arm strays from the
recorded one within half a second, and how each coefficient of the joints would change that.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'rollout': ['Rollout'],
        'rollout_error': ['RolloutError'],
        'rollout_windows': ['RolloutWindows', 'rollout_samples'],
    },
)
