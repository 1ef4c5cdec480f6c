"""From recorded motion to a physically consistent dynamic model."""
