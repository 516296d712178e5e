"""Every number that the article names, derived anew from the results, without the code that the article uses."""

import json
from decimal import Decimal

import numpy as np
import pandas as pd
from places import RESULTS

from replication import published
from workbook import judging

NORMAL = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
FIRST_SOURCE = ["authors", "simulated", "stand-in"]
REPRODUCED = {"theory_reproduced": "theoretical", "noise_reproduced": "noise"}


def read(name):
    return pd.read_csv(RESULTS / f"{name}.csv")


def says(text, number):
    """Whether a text such as 5.93·10⁻⁶ or 12.3 is a number rounded to its digits."""
    mantissa, _, power = text.partition("·10") if "·10" in text else (text, "", "")
    if text.startswith("10") and set(text[2:]) & set("⁻⁰¹²³⁴⁵⁶⁷⁸⁹"):
        mantissa, power = "1", text[2:]
    digits, scale = Decimal(mantissa), 10.0 ** int(power.translate(NORMAL) or 0)
    half = 0.5 * 10.0 ** digits.as_tuple().exponent * scale
    return abs(float(digits) * scale - number) <= half * (1 + 1e-9)


def decided():
    """One verdict for each printed number: the first source that has one."""
    verdicts = {}
    for row in judging.verdicts(RESULTS).to_dict("records"):
        before = verdicts.get(row["id"])
        if before is None or FIRST_SOURCE.index(row["source"]) < FIRST_SOURCE.index(before["source"]):
            verdicts[row["id"]] = row
    return verdicts


def counted():
    of, claims = list(decided().values()), []
    for file in sorted((RESULTS / "outcomes").glob("*.json")):
        claims += [row["holds"] for row in json.loads(file.read_text(encoding="utf-8"))["claims"]]
    found = {"printed": len(of)}
    for name in ("reproduced", "erratum", "differs"):
        found[name] = sum(row["verdict"] == name for row in of)
        found[f"tolerance_{name}"] = sum(row["by_tolerance"] == name for row in of)
    found["evidence"] = found["reproduced"] + found["erratum"] + found["differs"]
    for name, word in (("undecided",) * 2, ("consistent",) * 2, ("given",) * 2, ("standin", "stand-in")):
        found[name] = sum(row["verdict"] == word for row in of)
    for word in ("reproduced", "differs", "undecided"):
        found[f"table1_{word}"] = sum(row["id"].startswith("table1.") and row["verdict"] == word for row in of)
    good = [row["id"] for row in of if row["verdict"] == "reproduced"]
    found |= {name: sum(cell.endswith(f".{end}") for cell in good) for name, end in REPRODUCED.items()}
    found["from_simulator"] = sum(row["verdict"] == "reproduced" and row["source"] == "simulated" for row in of)
    found["text_reproduced"] = sum(cell.startswith("text.") for cell in good)
    table = pd.read_csv(published.DATA / "claims.csv")
    found |= {"claims": len(table), "claims_hold": claims.count(True), "claims_fail": claims.count(False)}
    found |= {"claims_open": claims.count(None)}
    found["claims_changed"] = sum("Changed after a first result was seen" in reason for reason in table["reason"])
    found["claims_together"] = sum("Committed together with the first result" in reason for reason in table["reason"])
    kinds = list(pd.read_csv(published.DATA / "errata.csv")["kind"])
    found |= {"errata_paper": kinds.count("paper"), "errata_data": kinds.count("against the public data")}
    return found | {"errata_repository": kinds.count("public repository")}


def regions():
    verdicts, printed = decided(), published.cells()["value"]
    found = {"level": 95, "regions": 20, "regions_missed_by_chance": 1, "means_inside": 0, "theory_outside": 0}
    halves = []
    for name in ("mean", "sd"):
        words = [verdicts[f"table2.row{row:02d}.{name}"]["verdict"] for row in range(1, 11)]
        found |= {f"{name}_{word}": words.count(word) for word in ("reproduced", "differs", "undecided")}
    for row in range(1, 11):
        low, high = (verdicts[f"table2.row{row:02d}.mean"][end] for end in ("low", "high"))
        found["means_inside"] += low <= float(printed[f"table2.row{row:02d}.mean"]) <= high
        found["theory_outside"] += not low <= float(printed[f"table2.row{row:02d}.theoretical"]) <= high
        halves.append(100 * ((high / low) ** 0.5 - 1))
    sds = [verdicts[f"table2.row{row:02d}.sd"] for row in range(1, 11)]
    factors = [float(f"{sd['high'] / sd['low']:.1g}") for sd in sds]
    found |= {"sd_factor_low": min(factors), "sd_factor_high": max(factors)}
    return found | {"region_half_low": min(halves), "region_half_high": max(halves)}


def of_table2():
    table = read("table2")
    table = table[table["row"] <= 10]
    means = {row: float(published.value(f"table2.row{row:02d}.mean")) for row in range(1, 11)}
    worst, rms = {}, {}
    for (source, _), part in table.groupby(["source", "realisation"]):
        off = [100 * (best / means[row] - 1) for row, best in zip(part["row"], part["best_A_rps"], strict=True)]
        worst.setdefault(source, []).append(max(map(abs, off)))
        rms.setdefault(source, []).append((sum(x * x for x in off) / len(off)) ** 0.5)
    authors = table[table["source"] == "authors"]
    share = [100 * best / runs for best, runs in zip(authors["best_basin_runs"], authors["runs"], strict=True)]
    printed_sd = [float(published.value(f"table2.row{row:02d}.sd")) for row in range(1, 11)]
    ends = {
        **{"best_worst": worst["authors"], "best_rms": rms["authors"], "simulated_worst": worst["simulated"]},
        **{"best_share": share, "sd": authors["sd_A_rps"], "sd_best": authors["best_sd_A_rps"]},
        "sd_printed": printed_sd,
    }
    found = {f"{name}_low": min(values) for name, values in ends.items()}
    found |= {f"{name}_high": max(values) for name, values in ends.items()}
    found |= {"population": 300, "iterations": 200, "realisations": len(worst["authors"])}
    seeds = read("table2_other_seeds")
    found["seeds_flipped"] = sum(a != b for a, b in zip(seeds["verdict"], seeds["verdict_other_seeds"], strict=True))
    both = [*zip(seeds["id"], seeds["verdict"], seeds["verdict_other_seeds"], strict=True)]
    of_sds = [after for cell, before, after in both if cell.endswith(".sd") and before == "differs"]
    found |= {"sd_differ_still": of_sds.count("differs"), "seeds_sd_undecided": of_sds.count("undecided")}
    found["seeds_new_differs"] = [after for _, before, after in both if before != "differs"].count("differs")
    found["runs_all"] = read("table2")["runs"].sum()
    return found | {"runs": int(read("table2_runs").groupby(["source", "realisation", "row"])["seed"].nunique().max())}


def of_stored_runs():
    stored = published.authors_notebook_runs()
    ends = read("replay_ends")["difference_rps"].abs()
    as_many = read("replay_ends")["stored_generations"] == read("replay_ends")["our_generations"]
    generations = published.authors_notebook_generations().merge(read("replay"), on=["run", "generation"])
    apart = (generations["best_rmse_rps"] - generations["best_rmse_of_generation_rps"]).abs()
    lowest = stored["final_rmse_rps"].min()
    return {
        "stored_runs": len(stored),
        "stored_best": int((stored["final_rmse_rps"] <= 1.002 * lowest).sum()),
        "stored_in_full": generations["run"].nunique(),
        "stored_generations": len(published.authors_notebook_generations()),
        "replayed": int((ends < 1e-9).sum()),
        "replayed_same_count": int(((ends < 1e-9) & as_many).sum()),
        "replay_apart": ends[ends < 1e-9].max(),
        "replay_generations": int((apart < 1e-9).sum()),
    }


def of_versions():
    table = read("library_versions").set_index("search")
    seeds, today = (table.loc[name].to_dict() for name in ("the same, other seeds", "today's cma"))
    more = today["apart_percent"] > today["chance_high_percent"]
    return {
        "seeds_runs": seeds["runs"] / seeds["records"],
        **{f"seeds_chance{end}": seeds[f"chance{end}_percent"] for end in ("", "_low", "_high")},
        "today_runs": today["runs"] / today["records"],
        "today_records": today["records"],
        "today_apart": today["apart_percent"],
        **{f"today_chance_{end}": today[f"chance_{end}_percent"] for end in ("low", "high")},
        **{f"today_best_shift_{end}": today[f"best_shift_{end}_percent"] for end in ("low", "high")},
        "today_against_chance": "more than" if more else "no more than",
    }


def of_equation_10():
    delta = 1e-4 * np.arange(3, 22, 2)
    rpm = 60 * np.array([published.value(f"table2.row{row:02d}.theoretical") for row in range(1, 11)])
    squares = np.linalg.lstsq(np.vander(rpm / 60, 4), delta, rcond=None)[1][0]
    printed = published.value("equation10.rmse")
    rmse = (squares / 10) ** 0.5
    misses = delta - sum(1e-6 * published.value(f"equation10.A{k}") * rpm**k for k in range(4))
    in_rps = [sum(1e-6 * published.value(f"equation10.A{k}") * A**k for k in range(4)) for A in rpm / 60]
    return {
        "rmse10": rmse,
        "rmse10_of_freedom": (squares / 6) ** 0.5,
        "rmse10_rounded": (misses @ misses / 10) ** 0.5,
        "rmse10_rounded_of_freedom": (misses @ misses / 6) ** 0.5,
        "rmse10_ratio": round(rmse / printed, -3),
        "printed_rmse10": printed,
        "largest_in_rps": max(in_rps),
    }


def of_the_simulator():
    table, refit = read("simulator_validation"), read("alpha_refit").set_index("alpha_per_rad")["nrmse"]
    facts = read("dead_zone_facts").set_index("alpha_per_rad").loc[1e5]
    friction = read("table3_friction").set_index("friction_share")["A_rps"]
    errors = read("features_logs")
    mean_error = errors.assign(size=errors["error_rad"].abs()).groupby("method")["size"].mean()
    ranking = read("protocol_variants").query("protocol == 'T_d and T_f as printed'")["mean_error_percent"]
    nrmse = table["nrmse"].dropna()
    return {
        "models_tried": len(pd.read_csv(published.DATA / "simulator_attempts.csv")),
        "nrmse_records": len(nrmse),
        "nrmse_used": (table["used_in_fit"] & table["nrmse"].notna()).sum(),
        "nrmse_left_out": 100 * table.loc[~table["used_in_fit"], "nrmse"].max(),
        "nrmse_mean": 100 * nrmse.mean(),
        "nrmse_largest": 100 * nrmse.max(),
        "peak_error": (100 * (table["peak_rps"] / table["printed_A_rps"] - 1)).abs().max(),
        "alpha": 1e5,
        "alpha_jump": facts["jump_nm"],
        "alpha_leak": 100 * (1 - 2 / np.pi * np.arctan(1e5 * 15e-4)),
        "alpha_misfit": 100 * refit[1e5],
        "softer_alpha": 1e4,
        "softer_misfit": 100 * refit[1e4],
        "friction_share": 2,
        "friction_change": abs(100 * (friction[0.02] / friction[0.0] - 1)),
        "eq10_error": mean_error["equation 10"],
        "joint_error": mean_error["joint, all nuisances free"],
        "printed_period_error": ranking.abs().mean(),
        "T_f": read("verdicts").query("id == 'table1.T_f.max' and source == 'authors'")["reproduced"].item(),
        "printed_T_f": float(published.cells().loc["table1.T_f.max", "printed"]),
    }


def of_optimizers():
    """Runs that found the best basin, counted from the single runs."""
    runs, counts = read("optimizers").groupby("method")["found"], {}
    for name, method in (("own_population", ""), ("restarts", ", restarts doubling it")):
        found = runs.get_group(f"CMA-ES, its own population{method}")
        counts |= {f"{name}_found": found.sum(), f"{name}_runs": len(found)}
    return counts


def of_protocols():
    """The finding's sentence names how many of the candidates explain the table."""
    table = read("protocols")
    explain, every = int(table["explains"].sum()), len(table)
    start = f"{explain} of {every} candidate" if explain else f"None of {every} candidate"
    sides = dict(zip(table["protocol"], 2 * table[["p_means", "p_sds"]].min(axis="columns"), strict=True))
    best = max(sides, key=sides.get)
    return {
        "protocol_finding": start,
        "notebook_p": sides["authors' notebook"],
        "p_criterion": 0.05,
        "best_protocol": best,
        "best_protocol_sds": table.set_index("protocol").loc[best, "sds_outside"],
    }


def of_criteria():
    """The phrases begin with the first criterion that was not met."""
    failed = {name: read(f"{name}_bars").query("met == False").iloc[0] for name in ("self", "datasheet")}
    return {f"{name}_failed": f"{row['population']}: {row['figure'].replace('_', ' ')}" for name, row in failed.items()}


def derived():
    """All of them by name; a text stands for itself or for the beginning of a sentence."""
    parts = (counted, regions, of_table2, of_stored_runs, of_versions, of_equation_10, of_the_simulator, of_protocols)
    parts += (of_optimizers, of_criteria)
    return {name: value for part in parts for name, value in part().items()}
