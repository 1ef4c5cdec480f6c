"""The bridge on emulated boards, and the world in which they are: its time, its drone.

In comes what a bridge has, how fast time shall pass, and what a drone's rotors shall do; out goes
`EmulatedArm`, the world of a bridge whose arm nobody can hurt. The emulated boards are in
`hardware.emulation`.
"""
