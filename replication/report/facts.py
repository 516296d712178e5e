"""Numbers that the report's and the article's sentences hold, each read from the results."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from replication import published
from replication.report import cells as cells_of
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
    all_cells = cells_of.cells(verdicts)
    counts = cells_of.counts(all_cells)
    evidence = {name: counts.get(name, 0) for name in cells_of.EVIDENCE}
    found = {"printed": len(all_cells), "evidence": sum(evidence.values()), **evidence}
    sd = [cell for cell in all_cells if cell.element == "Table 2" and cell.column == "sd" and cell.row != "11"]
    told = [cell.deciding.verdict for cell in sd]
    found |= {f"sd_{verdict}": told.count(verdict) for verdict in ("reproduced", "differs", "undecided")}
    found["standins"] = counts.get("stand-in", 0)
    claims = judging.decided_claims(results)
    told = list(claims["verdict"])
    found |= {"claims": len(published.claims()), "claims_hold": told.count("holds")}
    found |= {"claims_fail": told.count("does not hold"), "claims_open": told.count("undecided")}
    found["errata"] = len(published.errata())
    return {name: str(value) for name, value in found.items()}


def _table2(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "table2.csv")
    of_authors = table[(table["source"] == "authors") & (table["theoretical_A_rps"] > 0)]
    rows = of_authors[of_authors["noise_level"] == of_authors["noise_level"].iloc[0]]
    printed = published.column("Table 2", "mean")[rows["row"].to_numpy() - 1]
    printed_sd = published.column("Table 2", "sd")[rows["row"].to_numpy() - 1]
    error = 100 * (rows["best_A_rps"].to_numpy() / printed - 1)
    share = rows["best_basin_runs"] / rows["runs"]
    return {
        "runs": str(rows["runs"].max()),
        "best_worst": f"{np.abs(error).max():.1f}",
        "best_rms": f"{np.sqrt(np.mean(error**2)):.1f}",
        "best_share_low": f"{100 * share.min():.0f}",
        "best_share_high": f"{100 * share.max():.0f}",
        **_range("sd", rows["sd_A_rps"]),
        **_range("sd_best", rows["best_sd_A_rps"]),
        **_range("sd_printed", printed_sd),
    }


def _range(name: str, values: pd.Series | np.ndarray) -> dict[str, str]:
    return {f"{name}_low": f"{np.min(values):.4f}", f"{name}_high": f"{np.max(values):.4f}"}


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
    today = table[table.index.str.startswith("today")].iloc[0]
    return {
        "library_apart": f"{today['means_apart_percent']:.1f}",
        "library_best_apart": f"{today['best_apart_percent']:.1f}",
        "seeds_apart": f"{table.loc['the same, other seeds', 'means_apart_percent']:.1f}",
    }


def _candidates(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "protocols.csv")
    likeliest = table.iloc[0]
    return {
        "candidates": str(len(table)),
        "likeliest": likeliest["protocol"],
        "likeliest_share": f"{100 * likeliest['share']:.0f}",
    }


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
        "printed_rmse10": _power(printed, 4),
        "rmse10_ratio": f"{float(f'{rmse / printed:.1g}'):.0f}",
        "largest_in_rps": _power(units["equation 10 with A in rps"].max()),
    }


def _simulator(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "simulator_validation.csv")
    nrmse = 100 * table["nrmse"].dropna()
    return {
        "nrmse_mean": f"{nrmse.mean():.1f}",
        "nrmse_largest": f"{nrmse.max():.1f}",
        "nrmse_records": str(len(nrmse)),
        "peak_error": f"{table['peak_error_percent'].abs().max():.1f}",
    }


def _dead_zone(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "dead_zone_facts.csv")
    soft = table.iloc[1]
    return {
        "soft_alpha": _power(soft["alpha_per_rad"], 0),
        "soft_jump": f"{soft['jump_nm']:.1f}",
        "soft_leak": f"{100 * soft['middle_share']:.1f}",
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


OF_VERDICTS: tuple[Callable[..., dict[str, str]], ...] = (_verdicts, _periods, _equation10)
PARTS: tuple[Callable[..., dict[str, str]], ...] = (
    *(*OF_VERDICTS, _table2, _stored_runs, _replay, _library, _candidates),
    *(_simulator, _dead_zone, _friction, _features, _protocols),
)
