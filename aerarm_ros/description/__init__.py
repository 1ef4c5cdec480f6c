"""The arm as data: URDF, configuration, packaged resources."""
