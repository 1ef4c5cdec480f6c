"""How stiffly PX4 holds a drone."""

from dataclasses import dataclass

from aerarm_ros.control.checks.gains import non_negative_number, positive


@dataclass(frozen=True)
class Px4Gains:
    """Parameters of PX4's multicopter loops, by their names there, with its defaults.

    Attributes
    ----------
    mpc_xy_p, mpc_z_p : float
        Velocity per position error [1/s].
    mpc_xy_vel_p_acc, mpc_z_vel_p_acc : float
        Acceleration per velocity error [1/s].
    mpc_xy_vel_i_acc, mpc_z_vel_i_acc : float
        Of its integral [1/s^2].
    mpc_xy_vel_d_acc, mpc_z_vel_d_acc : float
        Of its derivative [-].
    mc_att_p, mc_yaw_p : float
        Angular velocity per attitude error: MC_ROLL_P and MC_PITCH_P, MC_YAW_P [1/s].
    mc_rate_k : float
        Of all three that follow: MC_ROLLRATE_K and MC_PITCHRATE_K [-].
    mc_rate_p, mc_rate_i, mc_rate_d : float
        Moment per angular velocity error, its integral and the angular acceleration, as a share of
        the largest moment.
    mc_yawrate_p, mc_yawrate_i : float
    tilt_max : float
        MPC_TILTMAX_AIR [rad].
    thrust_min : float
        MPC_THR_MIN, a share of the largest.

    Raises
    ------
    ValueError
        If one is negative, or one of the proportional ones is not positive.
    """

    mpc_xy_p: float = 0.95
    mpc_z_p: float = 1.0
    mpc_xy_vel_p_acc: float = 1.8
    mpc_z_vel_p_acc: float = 4.0
    mpc_xy_vel_i_acc: float = 0.4
    mpc_z_vel_i_acc: float = 2.0
    mpc_xy_vel_d_acc: float = 0.2
    mpc_z_vel_d_acc: float = 0.0
    mc_att_p: float = 6.5
    mc_yaw_p: float = 2.8
    mc_rate_k: float = 1.0
    mc_rate_p: float = 0.15
    mc_rate_i: float = 0.2
    mc_rate_d: float = 0.003
    mc_yawrate_p: float = 0.2
    mc_yawrate_i: float = 0.1
    tilt_max: float = 0.785
    thrust_min: float = 0.12

    @classmethod
    def scaled(cls, mpc_xy_p: float, mc_att_p: float, mc_rate_k: float) -> 'Px4Gains':
        """Return gains whose horizontal velocity loop is in proportion to the position's."""
        share = mpc_xy_p / cls.mpc_xy_p
        return cls(
            mpc_xy_p=mpc_xy_p,
            mpc_xy_vel_p_acc=share * cls.mpc_xy_vel_p_acc,
            mpc_xy_vel_i_acc=share * cls.mpc_xy_vel_i_acc,
            mc_att_p=mc_att_p,
            mc_rate_k=mc_rate_k,
        )

    def __post_init__(self) -> None:
        """Check every value."""
        for name, value in vars(self).items():
            check = positive if name.endswith(('_p', '_p_acc', '_k')) else non_negative_number
            check(name, value)
