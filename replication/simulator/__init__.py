"""The simulated joint: its parameters, its compiled core, the simulation and its identification."""
