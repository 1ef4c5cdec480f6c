"""What the node that flies a drone is made of.

In come parameters and messages with places, ways and what the arm does; out go the pure objects of
`aerarm_ros.flight`, and what is wrong with a message.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'flight_inputs': ['ArmTopics', 'to_path', 'to_target'],
        'flown_drone': ['load_flown_drone'],
        'flight_parameters': ['FLIGHT_PARAMETERS', 'arm_feed_forward', 'flight_control'],
    },
)
