"""Typical sizes, SI units: factor 1 leaves a gap of some two to five times the noise floor at usual noise.

The gap is what remains after a refit of the nominal base parameters. The effects of the controller are the exception:
the loop hides them from the force, and their sizes are those at which the control law's own residual is plain.
"""

TYPICAL: dict[str, float] = {
    # controller
    "position_gain": 0.05,
    "velocity_gain": 0.05,
    "velocity_filter/lag": 1.0e-3,  # s
    "velocity_filter/window": 2.0,  # samples beyond two
    # actuator
    "amplifier_lag": 0.6e-3,  # s
    "time_delay": 0.55e-3,  # s
    "saturation": 0.12,  # of the peak
    "amplifier_dead_zone": 0.12,  # V
    "gain_nonlinearity/tanh": 0.09,  # 1/V
    "gain_nonlinearity/bend": 0.04,  # 1/V
    "drive_gain": 0.06,
    "cogging": 2.7,  # N
    # friction
    "asymmetric_coulomb": 2.5,  # N
    "asymmetric_viscous": 35.0,  # N s/m
    "stribeck": 7.0,  # N
    "quadratic_viscous": 1000.0,  # N s2/m2
    "position_friction/sine": 3.5,  # N
    "position_friction/bowl": 4.0,
    "position_friction/tilt": 3.0,
    "lead_friction": 2.5,  # N
    "local_friction": 8.0,  # N
    "presliding": 0.25,  # share of Coulomb friction
    "load_dependent_friction": 0.12,
    "friction_drift": 0.3,
    # coupling
    "coupling_damping/viscous": 400.0,  # N s/m
    "coupling_damping/power": 450.0,
    "coupling_damping/structural": 0.09,
    "cubic_stiffness/cubic": 0.05,
    "cubic_stiffness/tanh": 0.2,
    "backlash": 8e-6,  # m, half the gap
    "transmission_error": 4.5e-6,  # m
    # load side
    "second_flexible_mode": 8.0,  # kg, at 40 Hz
    "payload_change": 4.0,  # kg
    # sensor
    "encoder_periodic_error": 2.5e-6,  # m
    "encoder_quantisation": 3e-6,  # m
    # base and environment
    "base_flexibility": 1 / 600.0,  # 1/kg, at 30 Hz
    "offset": 3.0,  # N
    "cable_spring": 60.0,  # N/m
    "disturbance_pulses/force": 22.0,  # N
    "disturbance_pulses/volts": 0.65,  # V
    # outside
    "x_dwell_friction": 12.0,  # N
    "x_position_stiffness": 0.15,
    "x_missed_counts": 12e-6,  # m
    "x_mains": 4.0,  # N
    "x_notch": 0.35,
    "x_encoder_play": 5e-6,  # m
    "x_rate_limiter": 0.11,  # of the steepest command
    "x_heat_viscous": 1.0,
    "x_drag_memory": 3.5,  # N
    "x_ball_passing": 2.5,  # N
    "x_dropped_commands": 0.025,
    "x_relaxation": 0.18,  # of K12
    "x_supply_sag": 0.05,  # 1/V
    "x_dac_steps": 0.3,  # V
}
