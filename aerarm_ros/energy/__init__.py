"""Where the arm's energy goes.

In come an arm's configuration, its model with friction, and measured or planned motion; out go the
power of the drives, joules by joint and cause, and what it costs to hold a posture.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'balance_meter': ['BalanceMeter'],
        'drive_power': ['DrivePower'],
        'energy_balance': ['EnergyBalance'],
        'energy_model': ['EnergyModel'],
        'holding_loss': ['HoldingLoss'],
    },
)
