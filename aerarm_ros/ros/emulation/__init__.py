"""The bridge on emulated boards, with their simulation time and the emulated drone.

`EmulatedArm` is the emulated world of a bridge; its parameters are the bridge's, the speed of
simulation time, and the rotor commands of a drone. The emulated boards are in
`hardware.emulation`.
"""
