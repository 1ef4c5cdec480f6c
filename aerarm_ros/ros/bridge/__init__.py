"""The bridge as a node: `hardware.BridgeCycle` between topics, services and a loop.

In come commands, requests and parameters; out go states, the mode, and what is wrong.
`HardwareBridge` puts it together; nothing here decides what a motor does.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bridge_diagnostics': ['BridgeDiagnostics', 'Watched'],
        'bridge_parameters': ['BRIDGE_PARAMETERS'],
        'bridge_services': ['ACTIONS', 'BridgeServices', 'EVERYWHERE', 'STOPS'],
        'bridge_streams': ['BridgeStreams'],
        'bridge_timing': ['BridgeTiming'],
        'commissioning_topics': ['CommissioningTopics', 'RecordWatch'],
        'cycle_requests': ['Action', 'CycleRequests'],
        'hardware_bridge': ['HardwareBridge'],
        'invalid_transitions': ['answer_invalid_transitions'],
        'mode_log': ['ModeLog'],
        'rejection_log': ['RejectionLog'],
        'robot_description': ['RobotDescription'],
    },
)
