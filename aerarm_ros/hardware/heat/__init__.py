"""How warm the motors are, and what their supply bears.

In come measured currents, resistances and voltages; out go estimated temperatures, the time that is
left at the present current, the torque that each motor may still give, and why the arm has to stop.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'motor_temperature': ['MotorTemperature'],
        'supply_watch': ['SupplyWatch'],
        'thermal_limit': ['ThermalLimit'],
    },
)
