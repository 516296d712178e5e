"""The simulated joint: its parameters, its compiled core, the simulation and its identification.

What notebooks use most stands here; modules import it from where it is defined.
"""

from replication.simulator.parameters import changed_joint, identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import settled_peak_rps, simulate_many
