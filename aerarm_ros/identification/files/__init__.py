"""A result as files: estimates as YAML that nodes read, the URDF, numbers for other programs.

In comes an identification's result; out goes text, and a folder that is there whole or not at
all. An estimate can be read back.
"""
