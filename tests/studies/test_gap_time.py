import numpy as np
import pytest

from backlash.fitting.waveform import mean_turn
from replication.recording import Recording
from replication.simulator.parameters import identified_joint
from replication.simulator.recordings import simulate_recordings
from replication.simulator.simulate import simulate
from studies.gap_time import crossing_rad, find_gaps, time_in_gap

JOINT = identified_joint()


def test_with_a_motor_at_constant_speed_the_load_falls_as_the_cube_of_the_time():
    turn_s = JOINT.turn_period_s
    start = (
        (np.pi - JOINT.start_angle_rad) % (2 * np.pi) / (2 * np.pi) * turn_s
    )  # where gravity changes its sign
    found = crossing_rad(np.zeros(200), JOINT, (start, start + 0.02))
    cube = JOINT.ratios["gravity_per_s2"] * 2 * np.pi / turn_s * 0.02**3 / 6
    assert found == pytest.approx(cube / 2, rel=0.01)


@pytest.mark.parametrize("delta_rad", [5e-4, 15e-4])
def test_separations_lie_within_three_milliseconds_and_impacts_within_six_of_the_true_ones(
    delta_rad,
):
    run = simulate(JOINT, delta_rad, duration_s=1.0, sample_s=5e-5, step_s=5e-5)
    turn = mean_turn(simulate_recordings(JOINT, [delta_rad])[0], 200)
    for separation, impact in find_gaps(turn, JOINT, 0.01):
        assert np.abs((run.separation_time_s - separation + 0.1) % 0.4 - 0.1).min() < 3e-3
        assert np.abs((run.impact_time_s - impact + 0.1) % 0.4 - 0.1).min() < 6e-3


@pytest.mark.parametrize(("delta_rad", "within"), [(3e-4, 0.2), (9e-4, 0.05), (21e-4, 0.05)])
def test_the_time_in_the_gap_reads_a_clean_record(delta_rad, within):
    record = simulate_recordings(JOINT, [delta_rad])[0]
    assert time_in_gap(record, JOINT, 0.01) == pytest.approx(delta_rad, rel=within)


def test_a_log_shorter_than_a_turn_is_refused():
    t = np.arange(0.0, 0.3, 2e-3)
    with pytest.raises(ValueError, match="turn"):
        time_in_gap(Recording(t, np.full(t.size, 100.0), 100.0, 0.4, "short"), JOINT, 0.01)
