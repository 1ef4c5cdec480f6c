"""The arm on a physics engine that shares no dynamics with the controllers' model.

In come torques of the drives and what the arm is truly made of; out go true joint positions, on a
base that stands still or moves, and what an IMU on it would read.
"""

import os

import lazy_loader

# Nothing is drawn. MuJoCo would look for a window system at its import, in a process of its own.
os.environ.setdefault('MUJOCO_GL', 'disable')

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_plant': ['ArmPlant', 'PlantError'],
        'base_profile': ['BaseProfile', 'BaseState'],
        'moving_base_plant': ['MovingBasePlant'],
        'plant_parameters': ['PlantParameters', 'Spread'],
    },
)
