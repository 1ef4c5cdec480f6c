"""What a program or a notebook calls: `import aerarm_ros`.

In come bags, tables or arrays, and a URDF; out go arrays of what was recorded, identified arms
that say what they are worth, and motions worth recording. `docs/reference/python.md` shows it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'excitation': ['plan_excitation'],
        'identification': ['identify'],
        'identified_arm': ['IdentifiedArm'],
        'motions': ['Motion', 'from_arrays', 'read_bag'],
        'planned_excitation': ['PlannedExcitation'],
    },
)
