"""Energy balance of the arm.

The inputs are an arm's configuration, its model with friction, and measured or planned motion. The
package computes the drives' power, the energy by joint and cause, and the power for holding a
posture.
"""
