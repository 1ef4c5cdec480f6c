"""The bridge's node: `hardware.BridgeCycle` with topics, services and a periodic loop.

The node receives commands, requests and parameters. The node publishes states, the mode and
diagnostics. `HardwareBridge` assembles the parts; the control of the motors is in
`aerarm_ros.hardware`.
"""
