"""What one node asks of another: services of the bridge, a set point, a parameter.

In come a node and a wish; out goes what came of it, or an `ArmClientError` that says what to
check. Who answers is found first: a stop goes to every bridge, all else only to one.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_at_end': ['AT_END_PARAMETERS', 'ArmAtEnd'],
        'arm_client': ['ArmClient', 'ArmClientError', 'BRIDGES'],
        'bridge_finder': ['BridgeFinder'],
        'bridge_service': ['BridgeService'],
        'commissioning_client': ['CommissioningClient', 'EmulatedPerson'],
        'parameter_request': ['set_parameter'],
        'rejection_watch': ['RejectionWatch'],
        'set_point_request': ['SetPointRequest'],
        'service_call': ['ServiceCall'],
        'stop_request': ['StopRequest'],
        'stop_service': ['StopService'],
        'tool_request': ['ToolRequest'],
    },
)
