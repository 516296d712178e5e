"""A record made of a known signature and noise, for the tests of the fit."""

import numpy as np

from replication.records import Recording
from replication.signature import FloatArray, Parameters, h

TRUE = Parameters(A=-0.6, t0=0.0125, tau=15.0, omega=134.0, v_t=100.0, T2=0.1525, T1=0.0125)
TIME = 0.002 * np.arange(2401)


def make_record(X: Parameters = TRUE, t: FloatArray = TIME) -> Recording:
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, t.size)
    return Recording(t, 100 + h(t, X) + noise, 100.0, 0.4, "made")
