"""Numbers on Table 2 and equation 10 that texts name in braces, as `workbook.export` takes them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pandas import DataFrame, Series

from replication import published
from replication.arrays import FloatArray
from replication.table2 import error_percent
from studies.replay import AGREE_RPS, protocols

Facts = dict[str, Any]


def of_equation10(
    fitted_rmse: float, rounding_moves: FloatArray, units: DataFrame, errors: DataFrame
) -> Facts:
    """Of the cubic through the printed points, and of equation 10 at them, as notebook 6 has both."""
    n, unknowns = len(units), rounding_moves.size
    off = units["equation 10 with A in rpm"] - units["delta_rad"]
    error = errors["error_rad"].abs()
    printed_rmse = published.value("equation10.rmse")
    return {
        "rmse10": (fitted_rmse, ".2e"),
        "rmse10_of_freedom": (fitted_rmse * np.sqrt(n / (n - unknowns)), ".2e"),
        "rmse10_rounded": (np.sqrt(np.mean(off**2)), ".2e"),
        "printed_rmse10": (printed_rmse, ".4e"),
        "rmse10_ratio": (float(f"{fitted_rmse / printed_rmse:.1g}"), ".0f"),
        "rounding_moves_A0": (rounding_moves[0], ".2f"),
        "bound_small_ratio": (published.value("text.error_rad_small") / error.iloc[0], ".0f"),
        "bound_large_ratio": (published.value("text.error_rad_large") / error.max(), ".1f"),
        "largest_in_rps": (units["equation 10 with A in rps"].max(), ".1e"),
    }


def of_table2(regions: DataFrame, table: DataFrame, realisations: int, level: float) -> Facts:
    """Of the prediction intervals, and of `table2.table2` on the public records."""
    there = regions.loc[table["row"]].reset_index(drop=True)
    covered = table["mean_A_rps"].between(there["mean_low"], there["mean_high"])
    best = table.assign(error=error_percent(table, "best_A_rps")).pivot(
        index="row", columns="realisation", values="error"
    )
    means = table.pivot(index="row", columns="realisation", values="mean_A_rps")
    theory = regions["theoretical"].between(regions["mean_low"], regions["mean_high"])
    return {
        "level": (100 * level, ".0f"),
        "regions": 2 * len(regions),
        "regions_missed_by_chance": (2 * len(regions) * (1 - level), ".0f"),
        "theory_outside": (~theory).sum(),
        "pooled_settings": len(protocols.POOLED),
        "pooled_realisations": realisations,
        "covered_means": covered.sum(),
        "covered_of": len(table),
        "bias_public": (protocols.pooled_bias(means.to_numpy()), ".1f"),
        "sd_printed": (regions["sd"], ".4f"),
        "runs": protocols.RUNS,
        "runs_all": table["runs"].sum(),
        "realisations": table["realisation"].nunique(),
        "best_share": (100 * table["best_basin_runs"] / table["runs"], ".0f"),
        "best_worst": (best.abs().max(), ".1f"),
        "best_rms": (np.sqrt((best**2).mean()), ".1f"),
    }


def of_signature(own_error: DataFrame) -> Facts:
    """Of the signature's own error [%], without noise."""
    error = own_error["without noise"]
    return {"clean_error": (error, "+.1f"), "clean_error_mean": (error.mean(), ".1f")}


def of_settings(judged: DataFrame, whole: Mapping[str, float]) -> Facts:
    """Of `protocols.judge` by setting, and of the settings that judge together."""
    of_pooled = judged.loc[protocols.POOLED]
    drawn = judged[judged["start"] == "per record"]
    return {
        "candidates": len(judged),
        "candidates_left": (~judged["excluded"]).sum(),
        "joint_p_means": (whole["p_means"], ".2g"),
        "joint_p_sds": (whole["p_sds"], ".2g"),
        "settings_p_means": (of_pooled["p_means"], ".2g"),
        "settings_p_sds": (of_pooled["p_sds"], ".2g"),
        "drawn_start_bias": (drawn["bias_percent"], ".0f"),
        "drawn_start_p": (drawn["p_bias"].max(), ".1g"),
        "largest_population_p": (judged.loc["rpm, population 2000", "p_sds"], ".1g"),
    }


def of_bias(printed: float, kept: FloatArray, no_bias_p: float) -> Facts:
    """Of the pooled bias [%]."""
    return {
        "bias_printed": (printed, ".1f"),
        "bias_ours": (np.median(kept), ".1f"),
        "bias_each": (kept, ".1f"),
        "bias_p_none": (no_bias_p, ".2g"),
    }


def of_seeds(same: DataFrame, by_seeds: DataFrame) -> Facts:
    """Of realisations that are made again, and of `table2_noise.agreement_by_seeds`."""
    return {
        "made_again": len(same),
        "made_again_numbers": same.size,
        "made_again_same": same.to_numpy().sum(),
        "seed_sets": by_seeds.shape[1],
        "seeds_flipped": (by_seeds.nunique(axis=1) > 1).sum(),
    }


def of_noise(nearness: DataFrame, own_rms: Series) -> Facts:
    """Of how near the public noises and our own come to the printed means [%]."""
    of = nearness["rms_percent"]
    return {
        "nearest_own": (own_rms.min(), ".2f"),
        "own_noises": own_rms.size,
        "nearness_1": (of["R = 1"], ".2f"),
        "nearness_2": (of["R = 2"], ".2f"),
        "nearness_p": (nearness["p"].min(), ".2g"),
        "nearness_1_short": (nearness.loc["R = 1", "rms_without_last_turn"], ".2f"),
    }


def of_starts(bias_p: Series, each_run: DataFrame) -> Facts:
    """Of starts that are drawn for each record or run."""
    return {
        "drawn_bias_p": (bias_p.max(), ".1g"),
        "each_run_off": (each_run["off_percent"].abs().agg(["min", "max"]), ".0f"),
        "each_run_sd": (each_run["sd_A_rps"].agg(["min", "max"]), ".2f"),
    }


def of_replay(compared: DataFrame, ended: DataFrame, basins: DataFrame) -> Facts:
    """Of `replay.compare_generations`, `replay.compare_ends`, and the basins of the stored runs."""
    same_end = ended["difference_rps"] < AGREE_RPS
    same_count = ended["our_generations"] == ended["stored_generations"]
    return {
        "stored_runs": len(ended),
        "stored_best": basins["runs"].iloc[0],
        "stored_in_full": compared["run"].nunique(),
        "stored_generations": len(compared),
        "replayed": same_end.sum(),
        "replayed_same_count": (same_end & same_count).sum(),
        "replay_apart": (ended.loc[same_end, "difference_rps"].abs().max(), ".0e"),
        "replay_generations": (compared["difference_rps"] < AGREE_RPS).sum(),
    }


def of_versions(seeds: Series, today: Series) -> Facts:
    """Of other seeds and of today's library, rows of `basins.compare_searches`."""
    beyond = today["apart_percent"] > today["chance_high_percent"]
    return {
        "seeds_runs": (seeds["runs"] / seeds["records"], ".0f"),
        "seeds_chance": (seeds["chance_percent"], ".1f"),
        "seeds_chance_low": (seeds["chance_low_percent"], ".1f"),
        "seeds_chance_high": (seeds["chance_high_percent"], ".1f"),
        "today_runs": (today["runs"] / today["records"], ".0f"),
        "today_records": (today["records"], ".0f"),
        "today_apart": (today["apart_percent"], ".1f"),
        "today_chance": (today[["chance_low_percent", "chance_high_percent"]], ".1f"),
        "today_best_shift": (today[["best_shift_low_percent", "best_shift_high_percent"]], "+.1f"),
        "today_against_chance": "more than" if beyond else "no more than",
    }
