"""The coupling with backlash: stiffness and torque over the gap (equations 8 and 9, figure 9).

Near zero, equations 8 and 9 do not do what the text says of them:

* K_BL is K_s / 2 at the edge, and inside the gap it leaks: 2 K_s / (pi alpha delta) in the middle. The leak
  multiplies delta_theta - delta * sign(delta_theta), which points the wrong way inside the gap, so it pulls
  the teeth towards the nearer edge.
* sign() makes the torque jump by 2 K_s / (pi alpha) to either side of delta_theta = 0: a discontinuity.
* The D_s term steps up at the edge and may pull on separation.

All three vanish as alpha grows (the last but for D_s). The clamped dead zone has none of them:
nothing inside the gap, K_s and D_s outside, and a torque that never pulls.
"""

import numpy as np
from numpy.typing import ArrayLike

from replication.arrays import FloatArray


def stiffness(
    delta_theta_rad: ArrayLike,
    delta_rad: ArrayLike,
    stiffness_nm_per_rad: float,
    alpha_per_rad: float,
) -> FloatArray:
    """Variable coupling stiffness K_BL [N m/rad], equation 8 as printed.

    The arguments are those of equation 9.
    """
    x, delta = np.asarray(delta_theta_rad, dtype=float), np.asarray(delta_rad, dtype=float)
    arctans = np.arctan(alpha_per_rad * (x - delta)) - np.arctan(alpha_per_rad * (x + delta))
    return stiffness_nm_per_rad / np.pi * (np.pi + arctans)


def transmitted_torque(
    delta_theta_rad: ArrayLike,
    delta_omega_rad_per_s: ArrayLike,
    delta_rad: ArrayLike,
    stiffness_nm_per_rad: float,
    damping_nms_per_rad: float = 0.0,
    alpha_per_rad: float = 1e6,
    clamped: bool = False,
) -> FloatArray:
    """Torque on the load tau_l [N m], equation 9 as printed, or that of the clamped dead zone.

    Parameters
    ----------
    delta_theta_rad, delta_omega_rad_per_s, delta_rad : array_like
        Displacement theta_m / N - theta_l, its rate and half the gap; broadcast together.
    stiffness_nm_per_rad, damping_nms_per_rad, alpha_per_rad : float
        K_s, D_s and the sharpness of the edge.
    clamped : bool
        No torque inside the gap, K_s and D_s outside, never pulling.
    """
    x, delta = np.asarray(delta_theta_rad, dtype=float), np.asarray(delta_rad, dtype=float)
    damping = damping_nms_per_rad * np.asarray(delta_omega_rad_per_s, dtype=float)
    if clamped:
        beyond = np.sign(x) * np.maximum(np.abs(x) - delta, 0.0)
        pushing = np.sign(x) * np.maximum(
            np.sign(x) * (stiffness_nm_per_rad * beyond + damping), 0.0
        )
        return np.where(np.abs(x) > delta, pushing, 0.0)
    displacement = x - delta * np.sign(x) + damping / stiffness_nm_per_rad
    return displacement * stiffness(x, delta, stiffness_nm_per_rad, alpha_per_rad)
