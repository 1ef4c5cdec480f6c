"""The physics engine behind the emulated boards."""
