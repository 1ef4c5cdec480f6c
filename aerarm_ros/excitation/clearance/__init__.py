"""How far the links keep from each other and from the ground.

In come the shapes of a URDF and postures; out go the pairs worth looking at, and the smallest
distance along a motion, without a gap between its samples.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'clearance_checker': ['Clearance', 'ClearanceChecker'],
        'collision_geometry': [
            'build_collision_geometry',
            'touches_ground',
            'link_of',
            'motion_bounds',
        ],
        'collision_pairs': ['CollisionPairs', 'select_pairs'],
    },
)
