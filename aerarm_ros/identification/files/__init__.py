"""Output files of an identification: YAML estimates, the URDF, and data for other programs.

The result folder is written completely or not at all. An estimate can be read back.
"""
