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
from replication.standins import joints
from replication.statistics import predictive_region, rate_columns
from studies.benchmark import JOINT_ALL_FREE
from tests.tools.changes import NOTEBOOKS, changes, parse, run, says_what_happened
from workbook import judging

# Changes that touch different results are made in one run, to save time.
TOGETHER = {
    "03_identification_of_the_joint": [["alphas = [1e3]", 'profiled = "leaky_rate_per_s"']],
    "05_growth_figure11": [["noise_rps = 0.18", 'changes = {"gravity_per_s2": 1.2}']],
    "09_identification": [["level = 13", "strategy_runs = 30"]],
    "11_robots_table4": [["coupling = 0.0", "loud_coupling = 0.3"]],
    "13_readings_compared": [
        [
            "smoothing_s = 0.02",
            "false_alarm_rate = 0.1",
            'left_out = ["load Coulomb friction", "load viscous friction"]',
        ]
    ],
    "17_protocols": [['shown = "authors\' notebook"', 'criteria = {"random_start": 0.2}']],
    "18_claims": [['criteria = {"quality_decreases": 0.2}', "turns = [1, 3]"]],
}


def committed(name):
    results = workbook.ROOT / "results"
    file = results / f"{name}.csv"
    return pd.read_csv(file if file.exists() else results / "supplement" / file.name)


def verdict_of(found, cell):
    return judging.judge_cells({cell: found[cell]}, "authors")["verdict"].item()


# ----------------------------------------------------------------------------------------------------- the outcomes


def a_larger_ring_and_a_smaller_error(n):
    assert n["A"] > 2 * 0.3825
    assert abs(n["error_percent"]) < 4
    low, high = n["answer"].backlash_interval_rad
    assert low < n["delta_rad"] == 1.5e-3 < high


def equation_10_finds_little_more_than_half(n):
    spacing = np.diff(n["impact_time"])[0]
    assert abs(spacing - 0.2) > 2e-3
    assert 0.5 < n["found_rad"] / n["delta_rad"] < 0.65
    low, high = n["answer"].backlash_interval_rad
    assert low < n["delta_rad"] < high


def equation_10_errs_as_much_without_noise(n):
    assert np.array_equal(n["log"].v, n["clean"].v)
    assert -13 < n["error_percent"] < -7


def a_run_of_the_commonest_basin(n):
    _, t0, _, _, _, T2, _ = n["X"]
    assert n["stored"]["final_rmse_rps"] == pytest.approx(0.159, abs=5e-4)
    assert n["basins"]["runs"].idxmax() == n["stored_runs"].set_index("run").loc[1, "basin"]
    assert t0 < 1e-3
    assert pytest.approx(0.1, abs=0.01) == T2


def figure_6_barely_changes_and_the_fit_misses_half_of_A(n):
    assert 0 < n["timing"].T_f / 0.4 - 1 < 0.021
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
    quiet = n["simulate_recordings"](n["joint"], [n["level_delta_rad"](12)])[0]
    added = np.abs(n["speed"].v - quiet.v)
    assert 0.17 < added.max() <= 0.18
    assert published.value("table2.row10.noise") == pytest.approx(0.18, abs=0.005)


def every_amplitude_grows(n):
    assert (
        n["peaks"]["amplitude_rps"].to_numpy() > committed("growth")["amplitude_rps"].to_numpy()
    ).all()


def a_quarter_as_high(n):
    high = n["simulate_recordings"](n["joint"], [n["level_delta_rad"](12)])[0]
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


def chance_alone_moves_the_means_more(n):
    few = n["versions"].set_index("search")["chance_percent"].max()
    many = committed("library_versions").set_index("search")["chance_percent"].max()
    assert few > 2 * many


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
    assert n["same_law"] < 0.01
    decided = n["verdicts"].query("id.str.contains('table2.*(?:mean|sd)')")["verdict"]
    assert set(decided) == {"undecided"}


def table_2_is_decided_as_before(n):
    before = committed("verdicts").query("source == 'authors'").set_index("id")["verdict"]
    now = n["verdicts"].query("id.str.startswith('table2')").set_index("id")["verdict"]
    assert now.to_dict() == before[now.index].to_dict()


def the_claim_on_local_minima_fails(n):
    before = committed("claims").set_index("id")["verdict"]
    now = n["verdicts"].set_index("id")["verdict"]
    assert (before["local_minima"], now["local_minima"]) == ("holds", "does not hold")


def the_global_fit_is_still_the_lowest(n):
    assert n["best"].rmse <= n["replay"]["rmse_rps"].min() * (1 + 1e-9)


def the_intervals_narrow(n):
    assert (n["costs"]["runs"] == 30).all()
    runs = committed("identification_strategies")["runs"].unique().item()
    for found in (0, 10, 20, 30):  # the same rate from the runs of the full notebook and from 30
        few, many = (rate_columns(found * size // 30, size) for size in (runs, 30))
        assert many["rate_high"] - many["rate_low"] < 0.7 * (few["rate_high"] - few["rate_low"])


def restarts_succeed_in_most_runs(n):
    small = n["costs"][~n["costs"]["strategy"].str.contains("1000")]
    assert small["rate"].mean() > 0.7


def a_comes_out_at_half(n):
    share = n["table"]["mean_A_rps"] / n["table"]["known_A_rps"]
    assert share.mean() == pytest.approx(0.5, abs=0.12)
    ratios = n["ratios"]["bench"] / n["ratios"]["identified"]
    assert ratios["speed_gain_per_s"] == pytest.approx(7 / 8, abs=0.04)
    assert ratios["integral_gain_per_s2"] == pytest.approx(1.1, abs=0.04)


def the_mean_error_grows_fivefold(n):
    before = abs(committed("table3_population")["error_percent"].mean())
    assert 3 < abs(n["population"]["error_percent"].mean()) / before < 8


def the_errors_scatter_a_third_as_much(n):
    errors = n["population"]["error_percent"]
    assert errors.mean() < 0
    assert errors.std() < 0.5 * committed("table3_population")["error_percent"].std()


def half_a_percent_of_friction_may_be_disregarded(n):
    assert n["claims"]["friction_disregarded"][0]


def five_percent_of_friction_takes_more_than_a_quarter(n):
    assert n["changes"].item() > 25


def no_friction_may_be_disregarded(n):
    assert n["claims"]["friction_disregarded"][0] is False


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
    assert (n["gap_table"]["found_instants_falling"] > 1.1).all()
    assert (n["errors"].query("method == 'time in the gap'")["error_rad"] > 0).all()


def more_false_alarms_and_a_smaller_backlash_seen(n):
    now, before = n["detected"].iloc[0], committed("detection").iloc[0]
    assert now["noise_half_amplitude_rps"] == before["noise_half_amplitude_rps"]
    assert now["false_alarms_high"] > 0.1
    assert now["smallest_seen_rad"] < before["smallest_seen_rad"]
    assert now["matched_filter_rad"] < before["matched_filter_rad"]


def without_friction_all_but_the_joint_err_less(n):
    now, before = (
        table.set_index("method")["rmse_rad"]
        for table in (n["ranked"], committed("robustness_ranking"))
    )
    assert (now / before)[["equation 10", "amplitude", "energy", "waveform"]].max() < 0.75
    assert now[JOINT_ALL_FREE] > 0.75 * before[JOINT_ALL_FREE]


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
    ranks = [judged[f"mean_rank_{row:02d}"] for row in n["rows"].index]
    assert n["rows"]["means below"].tolist() == ranks


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
    "00_start_here": {
        "backlash_mrad = 1.5": a_larger_ring_and_a_smaller_error,
        "friction_share = 0.05": equation_10_finds_little_more_than_half,
        "noise_rps = 0.0": equation_10_errs_as_much_without_noise,
    },
    "01_signature_figure6": {
        "run = 1": a_run_of_the_commonest_basin,
        "turn_period_s = 0.408": figure_6_barely_changes_and_the_fit_misses_half_of_A,
        'cost = "L1"': another_cost_gives_a_larger_A_in_the_same_basin,
    },
    "02_dead_zone_figure9": {
        "alphas = [1e8]": hardly_any_stiffness_left,
        "delta_rad = 3e-4": five_times_more_stiffness_left,
        "alphas = [4e5]": a_tenth_of_a_percent_left,
    },
    "03_identification_of_the_joint": {
        "alphas = [1e3]": the_misfit_exceeds_the_signal,
        'profiled = "leaky_rate_per_s"': the_misfit_hardly_rises,
        "alphas = [1e9]": the_misfit_of_the_clamped_dead_zone,
    },
    "04_simulator_figure10": {
        'changes = {"stiffness_per_s2": 1.05}': nearly_six_times_the_misfit,
        'changes = {"start_angle_rad": 0.5}': three_quarters_missed,
        "level = 13": within_the_lines_width,
    },
    "05_growth_figure11": {
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
        "seed_runs = 5": chance_alone_moves_the_means_more,
    },
    "08_noise_table2": {
        'settings = {"population": 30}': table_2_is_undecided,
        "fresh = 3": table_2_is_decided_as_before,
        'criteria = {"local_minima": 0.95}': the_claim_on_local_minima_fails,
    },
    "09_identification": {
        "level = 13": the_global_fit_is_still_the_lowest,
        "strategy_runs = 30": the_intervals_narrow,
        "budget = 120000": restarts_succeed_in_most_runs,
    },
    "10_bench_table3": {
        "bench_seed = 2": a_comes_out_at_half,
        'spread = {"load_friction": 0.05}': the_mean_error_grows_fivefold,
        'spread = {"ratios": 0.0, "load_friction": 0.0, "belt_rad": 0.0}': the_errors_scatter_a_third_as_much,
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
    "15_friction_and_wear": {
        "judged_shares = [0.005]": half_a_percent_of_friction_may_be_disregarded,
        "judged_shares = [0.05]": five_percent_of_friction_takes_more_than_a_quarter,
        'criteria = {"friction_disregarded": 2}': no_friction_may_be_disregarded,
    },
    "14_the_sensor_that_calibrates_itself": {
        "bench_seed = 4": another_joints_backlash_is_held,
        "backlash_rad = 5e-4": a_smaller_error_for_a_smaller_gap,
        "friction_share = 0.05": the_friction_is_told,
    },
    "13_readings_compared": {
        "smoothing_s = 0.02": the_time_in_the_gap_reads_too_large,
        "false_alarm_rate = 0.1": more_false_alarms_and_a_smaller_backlash_seen,
        'left_out = ["load Coulomb friction", "load viscous friction"]': without_friction_all_but_the_joint_err_less,
    },
    "17_protocols": {
        'shown = "authors\' notebook"': its_printed_numbers_are_ranked,
        'criteria = {"random_start": 0.2}': fewer_candidates_are_left,
        "most = 40": regions_reach_from_end_to_end,
    },
    "18_claims": {
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


def write_log(path, delta_rad):
    """Write the log of a bench that no notebook knows, and return the period of its turn."""
    bench = joints.draw_bench(np.random.default_rng(8))
    record = joints.encoder_log(bench, delta_rad, np.random.default_rng(9))
    pd.DataFrame({"time [s]": record.t, "motor speed [rps]": record.v}).to_csv(path, index=False)
    return record.turn_period_s


def test_a_log_of_ones_own_is_measured_first_and_says_what_was_assumed(tmp_path, capsys):
    period = write_log(tmp_path / "mine.csv", 8e-4)
    own = {"my_log": str(tmp_path / "mine.csv"), "my_turn_period_s": period}
    n = run("12_your_own_joint", own, tmp_path / "out")
    low, high = n["my_answer"].backlash_interval_rad
    assert n["my_answer"].verdict == "backlash"
    assert low < 8e-4 < high
    printed = capsys.readouterr().out
    assert printed.startswith(str(n["my_answer"]))
    assert "assumed: a load turn of 0.4 s" in printed


def test_a_log_that_is_not_there_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"nowhere\.csv: no such file") as error:
        run("12_your_own_joint", {"my_log": "nowhere.csv"}, tmp_path)
    assert "\n" not in str(error.value)
