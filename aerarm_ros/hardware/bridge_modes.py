"""What the bridge may be doing; `BridgeCycle` says what each mode means."""

MODES = (
    'disconnected',
    'idle',
    'aligning',
    'ready',
    'homing',
    'running',
    'damping',
    'fault',
)
