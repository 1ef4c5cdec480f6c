"""What the bridge may be doing.

- disconnected: a board does not answer.
- idle: the boards answer and are off.
- unhomed: likewise, and the zero of a joint is unknown. Only `home` and
  commissioning move the arm.
- aligning: the boards turn their motors to find the rotors' directions. The arm moves.
- ready: the arm is held where it is; no command has come yet.
- homing: the motors search the encoders' index pulses.
- commissioning: one motor turns its joint at low torque and speed, all others are off.
- running: the last command is followed.
- damping: the last command is too old, and nobody asked to `hold` the arm after it. The
  joints are damped, so the arm sinks slowly; the next good command is followed again, and
  `enable` or `hold` hold the arm where it is.
- fault: stopped for the reason that `faults` gives. The joints are damped where their
  board and encoder still work, until `clear_fault`.
"""

MODES = (
    'disconnected',
    'idle',
    'unhomed',
    'aligning',
    'ready',
    'homing',
    'commissioning',
    'running',
    'damping',
    'fault',
)
