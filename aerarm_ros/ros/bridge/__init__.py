"""The bridge as a node: `hardware.BridgeCycle` between topics, services and a loop.

In come commands, requests and parameters; out go states, the mode, and what is wrong.
`HardwareBridge` puts it together; nothing here decides what a motor does.
"""
