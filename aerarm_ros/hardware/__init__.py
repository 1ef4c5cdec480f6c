"""The bridge without ROS: from joint commands to frames, and from frames to joint states.

In comes a joint command and the time; out go the joints' state, the mode of the arm, and what is
wrong. `BridgeCycle` is the door: one cycle of 1 ms through the rooms inside, in the order of the
flow: the gate limits a command, the boards make frames of it, a transport carries them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=['frames', 'transports', 'heat', 'gate', 'boards', 'emulation'],
    submod_attrs={
        'bridge_cycle': ['BridgeCycle'],
        'bridge_modes': ['MODES'],
        'bridge_report': ['BridgeReport'],
        'fault_watch': ['FaultWatch'],
        'heat_watch': ['HeatWatch'],
        'load_watch': ['LoadCheck', 'LoadWatch'],
        'stopped_arm': ['StoppedArm', 'way_out'],
    },
)
