"""Who runs a node's callbacks, beside a loop that must not wait for them.

In comes a node; out goes its work, done in a second thread, in the slack of a cycle, or while
somebody waits for something.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'background_executor': ['BackgroundExecutor'],
        'lean_executor': ['LeanExecutor'],
        'spinning': ['spin_until', 'this_domain'],
        'steady_timer': ['create_steady_timer'],
        'waited_entity': ['WaitedEntity', 'WaitedWaitable', 'waited_entities'],
    },
)
