"""Safety gate: checks and limits joint commands before the bridge sends them to boards.

The gate validates each received command and limits it to the allowed positions, velocities,
efforts and effort rates, or it stops the arm for a reason.
"""
