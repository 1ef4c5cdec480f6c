"""The arm on a physics engine that shares no dynamics with the controllers' model.

In come torques of the drives and what the arm is truly made of; out go true joint positions, on a
base that stands still, moves as told or flies with rotors that are commanded too, and what an IMU
and an odometry on it would read.
"""

import os

import lazy_loader

# Nothing is drawn. MuJoCo would look for a window system at its import, in a process of its own.
os.environ.setdefault('MUJOCO_GL', 'disable')

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_plant': ['ArmPlant', 'PlantError'],
        'backlash_plant': ['BacklashPlant'],
        'base_profile': ['BaseProfile', 'BaseState'],
        'delayed_sensor': ['DelayedSensor'],
        'faulty_imu': ['FaultyImu', 'ImuErrors'],
        'flying_plant': ['FlyingPlant'],
        'free_base_plant': ['BaseBody', 'FreeBasePlant'],
        'moving_base_plant': ['MovingBasePlant'],
        'noisy_odometry': ['NoisyOdometry', 'OdometryErrors'],
        'plant_parameters': ['PlantParameters', 'Spread'],
        'random_drift': ['RandomDrift'],
        'rotors': ['Rotors'],
    },
)
