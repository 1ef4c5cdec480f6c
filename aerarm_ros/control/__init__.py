"""One control law a file: (state, reference, dt) -> command."""
