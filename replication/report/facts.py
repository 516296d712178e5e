"""Numbers that the report's and the article's sentences hold, each read from the results."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from replication import published
from replication.characteristic import fit_characteristic, printed_levels_rad
from replication.report import errata
from replication.simulator.study import simulator_attempts
from replication.studies import protocols
from replication.table2 import AUTHORS
from replication.workbook import judging

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def facts(results: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    """Collect every number that a sentence may hold, as text with sensible digits.

    Parameters
    ----------
    results : Path
        Folder of the results.
    verdicts : DataFrame
        As from `judging.verdicts`.

    Returns
    -------
    dict
        Those whose results are there; a sentence that needs another is left out.
    """
    found: dict[str, str] = {}
    for part in PARTS:
        try:
            found |= part(results, verdicts) if part in OF_VERDICTS else part(results)
        except (FileNotFoundError, KeyError, IndexError):
            continue
    return found


def _verdicts(results: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    decided = judging.deciding(verdicts)
    found = {"printed": len(decided), "evidence": int(decided["verdict"].isin(judging.EVIDENCE).sum())}
    for name in judging.VERDICTS:
        found[name.replace("-", "")] = int((decided["verdict"] == name).sum())
    for name in judging.EVIDENCE:
        found[f"tolerance_{name}"] = int((decided["by_tolerance"] == name).sum())
    claims = list(judging.decided_claims(results)["verdict"])
    found |= {"claims": len(published.claims()), "claims_hold": claims.count("holds")}
    found |= {"claims_fail": claims.count("does not hold"), "claims_open": claims.count("undecided")}
    known = published.claims()
    found["claims_changed"] = int((known["fixed"] > known["first_result"]).sum())
    return {name: str(value) for name, value in found.items()}


def _errata(_: Path) -> dict[str, str]:
    counted = errata.counts()
    found = {f"errata_{kind.split()[-1]}": str(number) for kind, number in counted.items()}
    return {"errata": str(sum(counted.values()))} | found


def _regions(_: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    """How many of the regions of Table 2's rows decide what, and where the theoretical A lies."""
    printed = published.cells("Table 2")
    decided = judging.deciding(verdicts).set_index("id").reindex(printed.index)
    rows = printed["row"].astype(str) != "11"
    found = {}
    for name in ("mean", "sd"):
        told = list(decided.loc[rows & (printed["column"] == name), "verdict"])
        found |= {f"{name}_{verdict}": told.count(verdict) for verdict in ("reproduced", "differs", "undecided")}
    means = decided[rows & (printed["column"] == "mean")]
    theoretical = printed.loc[rows & (printed["column"] == "theoretical"), "value"].to_numpy(float)
    inside = (means["low"] <= means["published"]) & (means["published"] <= means["high"])
    half_percent = 100 * (np.sqrt(means["high"] / means["low"]) - 1)
    found |= {"means_inside": int(inside.sum()), "level": f"{100 * judging.LEVEL:.0f}"}
    found["theory_outside"] = int(((theoretical < means["low"]) | (means["high"] < theoretical)).sum())
    found["regions"] = int((rows & printed["column"].isin(["mean", "sd"])).sum())
    found["regions_missed_by_chance"] = f"{(1 - judging.LEVEL) * found['regions']:.0f}"
    found |= {"region_half_low": f"{half_percent.min():.1f}", "region_half_high": f"{half_percent.max():.0f}"}
    return {name: str(value) for name, value in found.items()}


def _table2(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "table2.csv")
    table = table[table["theoretical_A_rps"] > 0]
    table["error"] = 100 * (table["best_A_rps"] / published.column("Table 2", "mean")[table["row"] - 1] - 1)
    authors = table[table["source"] == "authors"]
    share = 100 * authors["best_basin_runs"] / authors["runs"]
    found = {"runs": str(authors["runs"].max()), "realisations": str(authors["realisation"].nunique())}
    found |= {"population": str(AUTHORS.population), "iterations": str(AUTHORS.iterations)}
    for source, prefix in (("authors", "best"), ("simulated", "simulated")):
        error = table[table["source"] == source].groupby("realisation")["error"]
        found |= _range(f"{prefix}_worst", error.agg(lambda part: part.abs().max()), 1)
        found |= _range(f"{prefix}_rms", error.agg(lambda part: np.sqrt((part**2).mean())), 1)
    found |= _range("best_share", share, 0) | _range("sd", authors["sd_A_rps"])
    found |= _range("sd_best", authors["best_sd_A_rps"])
    seeds = pd.read_csv(results / "table2_other_seeds.csv")
    found["seeds_flipped"] = str((seeds["verdict"] != seeds["verdict_other_seeds"]).sum())
    return found | _range("sd_printed", published.column("Table 2", "sd")[:10])


def _range(name: str, values: pd.Series | np.ndarray, digits: int = 4) -> dict[str, str]:
    return {f"{name}_low": f"{np.min(values):.{digits}f}", f"{name}_high": f"{np.max(values):.{digits}f}"}


def _power(value: float, digits: int = 1) -> str:
    """A number with its power of ten, as it is written by hand: 5.93·10⁻⁶."""
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    raised = f"10{str(int(exponent)).translate(RAISED)}"
    return raised if mantissa == "1" else f"{mantissa}·{raised}"


def _stored_runs(results: Path) -> dict[str, str]:
    basins = pd.read_csv(results / "stored_basins.csv")
    return {"stored_best": str(basins["runs"].iloc[0]), "stored_runs": str(basins["runs"].sum())}


def _replay(results: Path) -> dict[str, str]:
    ends = pd.read_csv(results / "replay_ends.csv")
    ours = pd.read_csv(results / "replay.csv").set_index(["run", "generation"])["best_rmse_rps"]
    stored = published.authors_notebook_generations().set_index(["run", "generation"])["best_rmse_of_generation_rps"]
    printed = (ours.reindex(stored.index) - stored).abs()
    apart = ends["difference_rps"].abs()
    same = apart < 1e-9  # far below what tells two basins apart, far above rounding
    return {
        "replayed": str(int(same.sum())),
        "replay_apart": _power(apart[same].max(), 0),
        "stored_in_full": str(stored.index.get_level_values("run").nunique()),
        "replay_generations": str(int((printed < 1e-9).sum())),
        "stored_generations": str(len(printed)),
    }


def _library(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "library_versions.csv").set_index("search")
    seeds, today = table.loc["the same, other seeds"], table.loc["today's cma"]
    found = {
        "seeds_runs": f"{seeds['runs'] / seeds['records']:.0f}",
        "seeds_chance": f"{seeds['chance_percent']:.1f}",
        "seeds_chance_low": f"{seeds['chance_low_percent']:.1f}",
        "seeds_chance_high": f"{seeds['chance_high_percent']:.1f}",
        "today_runs": f"{today['runs'] / today['records']:.0f}",
        "today_records": f"{today['records']:.0f}",
        "today_apart": f"{today['apart_percent']:.1f}",
        "today_chance_low": f"{today['chance_low_percent']:.1f}",
        "today_chance_high": f"{today['chance_high_percent']:.1f}",
    }
    more = today["apart_percent"] > today["chance_high_percent"]
    found["today_against_chance"] = "more than" if more else "no more than"
    found |= {f"today_best_shift_{end}": f"{today[f'best_shift_{end}_percent']:+.1f}" for end in ("low", "high")}
    return found


def _candidates(results: Path) -> dict[str, str]:
    judged = protocols.whole_table_p(results)
    found = {"candidates": str(len(judged)), "candidates_explaining": str(judged["explains"].sum())}
    of_notebook = judged.loc["authors' notebook"]
    numbers = {f"notebook_{name}": f"{of_notebook[name]:.2g}" for name in ("p_means", "p_sds", "p")}
    return found | numbers | {"protocol_finding": protocols.finding(judged)}


def _outcome(verdicts: pd.DataFrame, cell: str) -> float:
    """Our number from the authors' data."""
    return float(verdicts.set_index(["id", "source"]).loc[(cell, "authors"), "reproduced"])


def _periods(_: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    printed = published.cells()["printed"]
    return {
        "T_d": f"{_outcome(verdicts, 'table1.T_d.max'):.3f}",
        "T_f": f"{_outcome(verdicts, 'table1.T_f.max'):.3f}",
        "printed_T_d": printed["table1.T_d.max"],
        "printed_T_f": printed["table1.T_f.max"],
    }


def _equation10(results: Path, verdicts: pd.DataFrame) -> dict[str, str]:
    rmse, printed = _outcome(verdicts, "equation10.rmse"), published.value("equation10.rmse")
    units = pd.read_csv(results / "equation10_units.csv")
    return {
        "rmse10": _power(rmse, 2),
        "rmse10_of_freedom": _power(_rmse_of_freedom(), 2),
        "printed_rmse10": _power(printed, 4),
        "rmse10_ratio": f"{float(f'{rmse / printed:.1g}'):.0f}",
        "largest_in_rps": _power(units["equation 10 with A in rps"].max()),
    }


def _rmse_of_freedom() -> float:
    """RMSE of the cubic through the printed points with n - 4 degrees of freedom [rad]."""
    delta = printed_levels_rad()
    fitted = fit_characteristic(published.column("Table 2", "theoretical")[: delta.size], delta)
    return fitted.rmse_rad * float(np.sqrt(delta.size / (delta.size - 4)))


def _simulator(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "simulator_validation.csv")
    nrmse = 100 * table["nrmse"].dropna()
    return {
        "models_tried": str(len(simulator_attempts())),
        "nrmse_mean": f"{nrmse.mean():.1f}",
        "nrmse_largest": f"{nrmse.max():.1f}",
        "nrmse_records": str(len(nrmse)),
        "peak_error": f"{table['peak_error_percent'].abs().max():.1f}",
    }


def _dead_zone(results: Path) -> dict[str, str]:
    """Leak and jump at the softest edge that the records allow."""
    table = pd.read_csv(results / "dead_zone_facts.csv").set_index("alpha_per_rad")
    refitted = pd.read_csv(results / "alpha_refit.csv").set_index("alpha_per_rad")["nrmse"]
    alpha, softer = 1e5, 1e4
    return {
        "alpha": _power(alpha, 0),
        "alpha_jump": f"{table.loc[alpha, 'jump_nm']:.2f}",
        "alpha_leak": f"{100 * table.loc[alpha, 'middle_share']:.1f}",
        "alpha_misfit": f"{100 * refitted[alpha]:.1f}",
        "softer_alpha": _power(softer, 0),
        "softer_misfit": f"{100 * refitted[softer]:.1f}",
    }


def _friction(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "table3_friction.csv").set_index("friction_share")
    return {"friction_share": "2", "friction_change": f"{abs(table.loc[0.02, 'change_percent']):.0f}"}


def _features(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "features.csv").set_index("method")["mean_abs_error_rad"]
    return {
        "eq10_error": _power(table["equation 10"]),
        "joint_error": _power(table["joint, all nuisances free"]),
        "error_ratio": f"{table['equation 10'] / table['joint, all nuisances free']:.0f}",
    }


def _protocols(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "protocol_ranking.csv").set_index("protocol")["mean_abs_error_percent"]
    return {"printed_period_error": f"{table['T_d and T_f as printed']:.0f}"}


OF_VERDICTS: tuple[Callable[..., dict[str, str]], ...] = (_verdicts, _regions, _periods, _equation10)
PARTS: tuple[Callable[..., dict[str, str]], ...] = (
    *(*OF_VERDICTS, _errata, _table2, _stored_runs, _replay, _library, _candidates),
    *(_simulator, _dead_zone, _friction, _features, _protocols),
)
