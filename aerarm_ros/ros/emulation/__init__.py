"""The bridge on emulated boards, with their simulation time and the emulated drone.

`EmulatedArm` replaces the boards and the clock of a bridge. Its inputs are the bridge's parameters,
the speed of simulation time, and the rotor commands of a drone. The emulated boards are in
`hardware.emulation`.
"""
