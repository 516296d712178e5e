"""The backlash of a joint that turns round, or moves to and fro, under any drive, from its motor's speed and torque.

A load that the measured motor motion drives (`load`) is fitted to the torque (`problem`, of movements to and fro
`strokes`), in the unknowns of one table (`unknowns`). Least-squares descents start at many backlashes and frictions,
because each bounce of the teeth more or less is a minimum of its own, and go on beside the lowest end until none is
lower (`search`). That is the `answer`, unless another backlash fits nearly as well.
"""

from backlash.torque.answer import TorqueFit, fit_torque

__all__ = ["TorqueFit", "fit_torque"]
