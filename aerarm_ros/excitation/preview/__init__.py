"""A designed trajectory to look at before it is played.

In comes a `DesignResult`; out goes one HTML file with curves, margins and the moving arm.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_animation': ['ArmAnimation', 'scene'],
        'preview': ['Preview'],
        'shape_mesh': ['TriangleMesh', 'mesh_of_shape'],
    },
)
