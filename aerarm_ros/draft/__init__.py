"""Draft of the configuration files of a new arm, made from the arm's URDF.

The draft contains the drive train and the excitation settings as YAML. Every value that a URDF does
not provide is marked, with a sentence on how to determine it.
"""
