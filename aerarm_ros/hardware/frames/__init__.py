"""The wire: what stands where in a frame of 34 bytes.

In comes a profile (a YAML file) and a command for a board; out goes a frame. In comes a frame; out
goes what the board reports, or None where its check sum is wrong.
"""
