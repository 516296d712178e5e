"""What the notebooks say that a change does: every change of every "Try changing" is made and its outcome checked.

A new change needs a line in `OUTCOMES`: a function of the notebook's variables after the change, which asserts.
Notebooks run in this process with their quick parameters, those of `CHEAPER` and the change. `make changes` runs this,
once a week; that a change is allowed, `make test` tests (`tests/notebooks/test_changes.py`).
"""

import re

import numpy as np
import pandas as pd
import pytest

import workbook
from replication import published
from replication.authors import level_delta_rad
from replication.simulator.recordings import simulate_recordings
from replication.statistics import predictive_region
from tests.tools.changes import NOTEBOOKS, changes, parse, run, says_what_happened
from workbook import judging

# Changes that touch different results are made in one run, to save time.
TOGETHER = {
    "09_identification_of_the_joint": [["alphas = [1e3]", 'profiled = "leaky_rate_per_s"']],
    "04_growth_figure11": [["noise_rps = 0.18", 'changes = {"gravity_per_s2": 1.2}']],
    "11_robots_table4": [["coupling = 0.0", "loud_coupling = 0.3"]],
    "15_protocols": [['shown = "authors\' notebook"', 'criteria = {"random_start": 0.2}']],
    "16_claims": [['criteria = {"quality_decreases": 0.2}', "turns = [1, 3]"]],
}


def committed(name):
    results = workbook.ROOT / "results"
    file = results / f"{name}.csv"
    return pd.read_csv(file if file.exists() else results / "supplement" / file.name)


def verdict_of(found, cell):
    return judging.judge_cells({cell: found[cell]}, "authors")["verdict"].item()


# ----------------------------------------------------------------------------------------------------- the outcomes


def equation_10_does_not_say_zero(n):
    assert n["theoretical_A"] > 0.04
    assert 3.4e-5 < n["found_rad"] < 1.2e-4


def hardly_a_run_ends_in_a_wrong_minimum(n):
    assert n["strays"] <= 2
    assert n["A"] == pytest.approx(0.385, rel=0.03)


def the_scatter_stays_without_noise(n):
    assert np.array_equal(n["v"], n["clean"])
    assert n["strays"] >= 1
    assert 0.87 < n["found_rad"] / n["delta_rad"] < 0.94


def a_softer_coupling_rings_more_slowly(n):
    assert 1 < n["ring"].iloc[0, 0] / n["ring"].iloc[-1, 0] < 1.05
    assert n["mode"].imag < 120


def the_joint_rings_faster_and_longer(n):
    assert n["mode"].imag > 145
    assert -n["mode"].real < 10


def impacts_not_half_a_turn_apart(n):
    assert abs(np.diff(n["impacts"])[0] - 0.2) > 2e-3


def a_run_of_the_commonest_basin(n):
    _, t0, _, _, _, T2, _ = n["X"]
    assert n["stored"]["final_rmse_rps"] == pytest.approx(0.159, abs=5e-4)
    assert n["basins"]["runs"].idxmax() == n["table"].loc[1, "basin"]
    assert t0 < 1e-3
    assert pytest.approx(0.1, abs=0.01) == T2


def figure_6_barely_changes_and_the_fit_misses_half_of_A(n):
    assert 0 < n["protocol"].T_f / 0.4 - 1 < 0.021
    assert n["cells"]["text.turns"] == 12
    usual, yours = n["fits"].iloc[0], n["fits"].iloc[-1]
    assert (usual["T_f [s]"], yours["T_f [s]"]) == (0.4, 0.408)
    assert yours["RMSE [rps]"] / usual["RMSE [rps]"] == pytest.approx(6, abs=1)
    assert yours["|A| [rps]"] / usual["|A| [rps]"] == pytest.approx(0.5, abs=0.1)


def another_cost_gives_a_larger_A_in_the_same_basin(n):
    usual, yours = n["fits"].iloc[0], n["fits"].iloc[-1]
    assert (usual["cost"], yours["cost"], n["nearest"]) == ("RMSE", "L1", 1)
    assert yours["|A| [rps]"] / usual["|A| [rps]"] == pytest.approx(1.05, abs=0.02)
    assert yours["RMSE [rps]"] / usual["RMSE [rps]"] == pytest.approx(1.07, abs=0.02)
    assert yours["mean |residual| [rps]"] < usual["mean |residual| [rps]"]


def hardly_any_stiffness_left(n):
    assert n["facts"]["middle_share"].max() < 1e-5


def five_times_more_stiffness_left(n):
    wide = committed("dead_zone_facts").set_index("alpha_per_rad")["middle_share"]
    narrow = n["facts"].set_index("alpha_per_rad")["middle_share"]
    assert (narrow / wide)[[1e5, 1e6]].to_numpy() == pytest.approx(5, rel=0.05)


def a_tenth_of_a_percent_left(n):
    assert 0.0005 < n["facts"]["middle_share"].item() < 0.0015
    study = committed("joint_alpha").set_index("alpha_per_rad")["mean_nrmse_percent"]
    assert study[1e5] < 5


def the_misfit_exceeds_the_signal(n):
    assert n["alpha"].loc[0, "mean_nrmse_percent"] > 100
    facts = committed("dead_zone_facts")
    assert facts.loc[facts["alpha_per_rad"] == 1e3, "middle_share"].item() == pytest.approx(
        1 / 3, abs=0.05
    )


def the_misfit_hardly_rises(n):
    (profile,) = n["displayed"]
    misfit = profile.set_index("factor")["nrmse"]
    assert misfit[1.0] < misfit.max() < 1.05 * misfit[1.0]


def the_misfit_of_the_clamped_dead_zone(n):
    sharp, clamped = n["alpha"]["mean_nrmse_percent"]
    assert sharp == pytest.approx(clamped, rel=5e-4)


def nearly_six_times_the_misfit(n):
    ratio = n["table"]["nrmse"].mean() / committed("simulator_validation")["nrmse"].mean()
    assert 5.5 < ratio < 6


def three_quarters_missed(n):
    assert n["table"]["nrmse"].mean() == pytest.approx(0.75, abs=0.1)


def within_the_lines_width(n):
    off = n["run"].motor_speed_rps[n["shown"]] - n["records"][n["delta_rad"]].v[n["shown"]]
    assert n["delta_rad"] == max(n["records"])
    assert np.abs(off).max() < 0.02 * np.ptp(n["run"].motor_speed_rps[n["shown"]])


def noise_over_figure_5(n):
    quiet = simulate_recordings(n["joint"], [level_delta_rad(12)])[0]
    added = np.abs(n["speed"].v - quiet.v)
    assert 0.17 < added.max() <= 0.18
    assert published.value("table2.row10.noise") == pytest.approx(0.18, abs=0.005)


def every_amplitude_grows(n):
    assert (
        n["peaks"]["amplitude_rps"].to_numpy() > committed("growth")["amplitude_rps"].to_numpy()
    ).all()


def a_quarter_as_high(n):
    high = simulate_recordings(n["joint"], [level_delta_rad(12)])[0]
    assert np.abs(n["speed"].v - 100).max() / np.abs(high.v - 100).max() == pytest.approx(
        0.25, abs=0.04
    )


def all_but_the_constant_out_of_tolerance(n):
    assert verdict_of(n["cells"], "equation10.A0") == "consistent"
    assert {verdict_of(n["cells"], f"equation10.A{k}") for k in (1, 2, 3)} == {"differs"}


def all_four_coefficients_leave_their_tolerances(n):
    assert {verdict_of(n["cells"], f"equation10.A{k}") for k in range(4)} == {"differs"}
    printed = {k: published.value(f"equation10.A{k}") for k in range(4)}
    changes = [abs(n["cells"][f"equation10.A{k}"] / value - 1) for k, value in printed.items()]
    assert 0.09 < min(changes) < max(changes) < 0.43


def the_energy_finds_the_backlashes_too(n):
    assert (n["read"] == n["readings"]["energy"]).all()
    assert (n["read"] < n["peaks"]).all()
    assert n["reading_rmse"] < n["unseen"] < 1e-6


def the_search_begins_in_the_right_turn(n):
    assert n["ratio"] == pytest.approx(1, abs=0.002)
    assert n["found"].best[1] <= 0.2


def a_small_first_step_stays_in_the_middle_of_the_record(n):
    assert n["ratio"] == pytest.approx(4.6, abs=0.2)
    assert n["found"].best[1] == pytest.approx(2.4, abs=0.4)


def a_small_population_settles_early_in_a_bad_minimum(n):
    assert (n["c"].mu, round(n["c"].c_mu, 1)) == (10, 0.1)
    assert np.abs(n["after"].std / n["before"].std - 1).max() < 0.15
    stored = (
        published.authors_notebook_runs().set_index("cma_seed").loc[n["seed"], "final_rmse_rps"]
    )
    assert n["found"].misfit / stored == pytest.approx(6, rel=0.1)
    assert n["found"].stop == "tolfun"


def table_2_is_undecided(n):
    assert not n["holds_here"]
    decided = n["verdicts"].query("id.str.contains('table2.*(?:mean|sd)')")["verdict"]
    assert set(decided) == {"undecided"}


def ten_more_realisations_come_out_the_same(n):
    assert (len(n["own"]), n["same"].to_numpy().all()) == (30, True)
    before = committed("verdicts").query("source == 'authors'").set_index("id")["verdict"]
    now = n["verdicts"].query("id.str.startswith('table2')").set_index("id")["verdict"]
    assert now.to_dict() == before[now.index].to_dict()


def the_claim_on_local_minima_fails(n):
    before = committed("claims").set_index("id")["verdict"]
    now = n["verdicts"].set_index("id")["verdict"]
    assert (before["local_minima"], now["local_minima"]) == ("holds", "does not hold")


def a_comes_out_at_half(n):
    share = n["table"]["mean_A_rps"] / n["table"]["known_A_rps"]
    assert share.mean() == pytest.approx(0.5, abs=0.12)
    ratios = n["ratios"]["bench"] / n["ratios"]["identified"]
    assert ratios["speed_gain_per_s"] == pytest.approx(7 / 8, abs=0.04)
    assert ratios["integral_gain_per_s2"] == pytest.approx(1.1, abs=0.04)


def the_mean_error_grows_fivefold(n):
    before = abs(committed("table3_population")["error_percent"].mean())
    assert 3 < abs(n["population"]["error_percent"].mean()) / before < 8


def half_a_percent_of_friction_may_be_disregarded(n):
    assert n["claims"]["friction_disregarded"][0]


def youden_errors(best):
    return best["false_alarms"] + 1 - best["detected"]


def the_kinds_still_overlap_without_couplings(n):
    before = committed("table4_thresholds").set_index("name").loc["best (Youden)"]
    assert 0 < youden_errors(n["best"]) <= 1.25 * youden_errors(before)
    assert youden_errors(n["best"]) > 0.5 * youden_errors(before)


def robot_b_has_half_the_backlash(n):
    before, now = committed("table4"), n["table"]
    assert now["mean_A_rps"].iloc[1] / before["mean_A_rps"][1] == pytest.approx(0.5, abs=0.12)
    threshold = (
        committed("table4_thresholds").set_index("name").loc["best (Youden)", "threshold_rps"]
    )
    assert n["best"]["threshold_rps"] / threshold == pytest.approx(1.0, abs=0.1)


def a_hardly_tells_the_kinds_apart(n):
    assert n["cases"]["area"].iloc[-1] < 0.65


def mean_error(table, name):
    return table.set_index("calibration").loc[name, "error_rad"].abs().mean()


def the_amplitude_errs_more_than_the_waveform(n):
    assert n["table"].query("calibration == 'your own'")["method"].unique().tolist() == [
        "amplitude"
    ]
    assert mean_error(n["table"], "your own") > mean_error(committed("own_joint"), "your own")


def answers_with_wider_intervals(n):
    found = n["table"].query("calibration == 'your own'")
    assert (found["verdict"] == "backlash").all()
    assert n["calibrated"].estimate.samples < 0.34 * 2401
    low, high = n["calibrated"].estimate.backlash_interval_rad
    whole = n["answer"](
        n["log"](n["backlash_rad"], 0, turns=12), n["ours"]
    ).estimate.backlash_interval_rad
    assert high - low > whole[1] - whole[0]


def your_own_calibration_still_beats_the_papers(n):
    assert mean_error(n["table"], "your own") < 0.5 * mean_error(n["table"], "the paper's joint")


def the_time_in_the_gap_reads_too_large(n):
    assert (n["errors"].query("method == 'time in the gap'")["error_rad"] > 0).all()


def rms_errors(n):
    return n["measured"].set_index("method")["rmse_rad"]


def only_the_amplitude_keeps_its_error(n):
    errors = rms_errors(n)
    assert errors["joint"] < 1e-6
    assert errors["amplitude"] > 2e-5


def the_bounds_fall_with_the_root_of_the_turns(n):
    kept = committed("limits").query("axis == 'turns' and value == 12").set_index("method")
    ratio = kept["rmse_rad"] / rms_errors(n)
    assert ratio[list(n["STARTS"])].to_numpy() == pytest.approx(np.sqrt(119 / 11), rel=0.2)


def another_joints_backlash_is_held(after):
    the_profile_is_near_laplaces_parabola(after)
    assert after["fit"].refusal_reason == ""
    assert after["fit"].interval_rad[0] < after["backlash_rad"] < after["fit"].interval_rad[1]


def the_profile_is_near_laplaces_parabola(after):
    profile = after["profile"].set_index("deviation")
    assert abs(profile.loc[0, "chi2"]) < 0.1
    assert profile.loc[[-2, 2], "chi2"].to_numpy() == pytest.approx(4, abs=2)
    assert profile["delta_rad"].is_monotonic_increasing


def a_smaller_error_for_a_smaller_gap(after):
    another_joints_backlash_is_held(after)
    assert after["fit"].sd_rad < 2.5e-5


def the_friction_is_told(after):
    another_joints_backlash_is_held(after)
    assert 0.045 < after["fit"].friction < 0.07


def its_printed_numbers_are_ranked(n):
    judged = n["judged"].set_index(["protocol", "reading"]).loc[n["shown"], "sd"]
    ranks = [judged[f"mean_rank_{row:02d}"] for row in n["ranks"].index]
    assert n["ranks"]["means below"].tolist() == ranks


def fewer_candidates_are_left(n):
    kept = committed("table2_protocols")
    assert n["judged"]["excluded"].sum() > kept["excluded"].sum()


def regions_reach_from_end_to_end(n):
    low, _ = predictive_region(n["numbers"][0][0])
    assert low == n["numbers"][0][0].min()


def the_quality_would_decrease(n):
    p = re.search(r"p of an increase ([\d.]+)", n["claims"]["quality_decreases"][1])
    assert 0.05 < float(p[1]) < 0.2
    assert n["claims"]["quality_decreases"][0] is True


def some_half_turns_differ(n):
    assert n["claims"]["same_amplitude"][0] is False
    assert n["growth"]["half_turn_spread"].min() < 0.005


def the_error_falls_by_less(n):
    fallen = n["by_turns"].pivot(index="delta_rad", columns="turns", values="rms_error_rps")
    ratio = fallen[3] / fallen[1]
    assert ratio.mean() < 1
    kept = committed("claims_turns").pivot(
        index="delta_rad", columns="turns", values="rms_error_rps"
    )
    assert ratio.mean() > (kept[12] / kept[1]).mean()


OUTCOMES = {
    "00_the_sensor": {
        "backlash_mrad = 0.0": equation_10_does_not_say_zero,
        "population = 300": hardly_a_run_ends_in_a_wrong_minimum,
        "noise_rps = 0.0": the_scatter_stays_without_noise,
    },
    "01_the_joint": {
        'changes = {"stiffness_per_s2": 0.5}': a_softer_coupling_rings_more_slowly,
        'changes = {"leaky_gain_per_s2": 0.0}': the_joint_rings_faster_and_longer,
        "friction_share = 0.05": impacts_not_half_a_turn_apart,
    },
    "05_signature_figure6": {
        "run = 1": a_run_of_the_commonest_basin,
        "turn_period_s = 0.408": figure_6_barely_changes_and_the_fit_misses_half_of_A,
        'cost = "L1"': another_cost_gives_a_larger_A_in_the_same_basin,
    },
    "02_dead_zone_figure9": {
        "alphas = [1e8]": hardly_any_stiffness_left,
        "delta_rad = 3e-4": five_times_more_stiffness_left,
        "alphas = [4e5]": a_tenth_of_a_percent_left,
    },
    "09_identification_of_the_joint": {
        "alphas = [1e3]": the_misfit_exceeds_the_signal,
        'profiled = "leaky_rate_per_s"': the_misfit_hardly_rises,
        "alphas = [1e9]": the_misfit_of_the_clamped_dead_zone,
    },
    "03_simulator_figure10": {
        'changes = {"stiffness_per_s2": 1.05}': nearly_six_times_the_misfit,
        'changes = {"start_angle_rad": 0.5}': three_quarters_missed,
        "level = 13": within_the_lines_width,
    },
    "04_growth_figure11": {
        "noise_rps = 0.18": noise_over_figure_5,
        'changes = {"gravity_per_s2": 1.2}': every_amplitude_grows,
        "speed_level = 2": a_quarter_as_high,
    },
    "06_characteristic_figure12": {
        "rpm_per_rps = 1.0": all_but_the_constant_out_of_tolerance,
        "left_out = [10]": all_four_coefficients_leave_their_tolerances,
        'reading = "energy"': the_energy_finds_the_backlashes_too,
    },
    "07_protocol_table1": {
        "sigma = 0.02": a_small_first_step_stays_in_the_middle_of_the_record,
        "population = 20": a_small_population_settles_early_in_a_bad_minimum,
        'box = {"start_s": (0.0, 0.2)}': the_search_begins_in_the_right_turn,
    },
    "08_noise_table2": {
        'settings = {"population": 30}': table_2_is_undecided,
        "made_again = 3": ten_more_realisations_come_out_the_same,
        'criteria = {"local_minima": 0.95}': the_claim_on_local_minima_fails,
    },
    "10_bench_table3": {
        "bench_seed = 2": a_comes_out_at_half,
        'spread = {"load_friction": 0.05}': the_mean_error_grows_fivefold,
        "judged_shares = [0.005]": half_a_percent_of_friction_may_be_disregarded,
    },
    "11_robots_table4": {
        "coupling = 0.0": the_kinds_still_overlap_without_couplings,
        "robot_seed = 2": robot_b_has_half_the_backlash,
        "loud_coupling = 0.3": a_hardly_tells_the_kinds_apart,
    },
    "12_your_own_joint": {
        'method = "amplitude"': the_amplitude_errs_more_than_the_waveform,
        "log_turns = 4": answers_with_wider_intervals,
        "bench_seed = 4": your_own_calibration_still_beats_the_papers,
    },
    "14_the_sensor_that_calibrates_itself": {
        "bench_seed = 4": another_joints_backlash_is_held,
        "backlash_rad = 5e-4": a_smaller_error_for_a_smaller_gap,
        "friction_share = 0.05": the_friction_is_told,
    },
    "13_readings_compared": {
        "smoothing_s = 0.02": the_time_in_the_gap_reads_too_large,
        'sweeps = {"noise_half_amplitude_rps": [0.005]}': only_the_amplitude_keeps_its_error,
        'sweeps = {"turns": [120]}': the_bounds_fall_with_the_root_of_the_turns,
    },
    "15_protocols": {
        'shown = "authors\' notebook"': its_printed_numbers_are_ranked,
        'criteria = {"random_start": 0.2}': fewer_candidates_are_left,
        "most = 40": regions_reach_from_end_to_end,
    },
    "16_claims": {
        'criteria = {"quality_decreases": 0.2}': the_quality_would_decrease,
        'criteria = {"same_amplitude": 0.005}': some_half_turns_differ,
        "turns = [1, 3]": the_error_falls_by_less,
    },
}


def test_every_change_that_a_notebook_proposes_has_its_outcome_checked():
    assert {name: set(changes(name)) for name in NOTEBOOKS} == {
        name: set(found) for name, found in OUTCOMES.items()
    }


def runs():
    """Notebooks with the changes that are made in one run of each."""
    found = []
    for notebook, outcomes in OUTCOMES.items():
        groups = TOGETHER.get(notebook, [])
        alone = [[change] for change in outcomes if not any(change in group for group in groups)]
        found += [
            pytest.param(notebook, group, id=f"{notebook}-{'-'.join(group)}")
            for group in [*groups, *alone]
        ]
    return found


@pytest.mark.parametrize(("notebook", "changed"), runs())
def test_a_change_does_what_its_notebook_says(notebook, changed, authors_data, tmp_path, capsys):
    parameters = {name: value for change in changed for name, value in parse(change).items()}
    variables = run(notebook, parameters, tmp_path)
    for change in changed:
        OUTCOMES[notebook][change](variables)
    assert says_what_happened(capsys.readouterr().out)
