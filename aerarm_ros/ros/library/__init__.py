"""What a program or a notebook calls: `import aerarm_ros`.

In come bags, tables or arrays, and a URDF; out go arrays of what was recorded, and identified arms
that say what they are worth. `docs/reference/python.md` shows it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'identification': ['identify'],
        'identified_arm': ['IdentifiedArm'],
        'motions': ['Motion', 'from_arrays', 'read_bag'],
    },
)
