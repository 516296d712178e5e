# %% [markdown]
# # 6 · From amplitude to backlash (equation 10, figure 12)
#
# *You will fit the sensor's characteristic, see in which unit it takes the amplitude, and what the
# printed digits can tell. Reading time: 9 min. Run time: 15 s. Before this: notebook
# [4](04_growth_figure11.ipynb).*
#
# ## Claim
#
# [Backlash](glossary.md#backlash) is a cubic of the amplitude, fitted to ten simulations with an
# RMSE of 8.6983·10⁻¹⁰ rad (section "Backlash signature behaviour"). Table 2's errors of $A$ mean
# less than 0.0002 rad at the smallest backlash, and 0.0004 rad at the largest.
#
# ## Method
#
# The characteristic as printed, with the amplitude $A$ and the backlash $\delta$ [rad]:
#
# $$\delta = f(A) = 10^{-6}\left(-0.0018\,A^3 + 0.4323\,A^2 + 9.2524\,A + 34.0313\right) \tag{10}$$
#
# The paper prints no unit of $A$. It turns out to be rpm (erratum E1), so the coefficient of $A^k$
# is in rad/rpm$^k$. The tables give $A$ in rps; 1 rps is 60 rpm.
#
# The ten points $(A_i, \delta_i)$ of figure 12 are printed: Table 2's [theoretical
# A](glossary.md#theoretical-a) and the levels of section "Dataset creation". A polynomial of degree
# $d$ with the coefficients $c_k$ is linear in them, so least squares has a direct solution, of this
# misfit:
#
# $$\min_c \sum_{i=1}^{n} \left(\sum_{k=0}^{d} c_k A_i^k - \delta_i\right)^2, \qquad
# \text{RMSE} = \sqrt{\frac{1}{n} \sum_{i=1}^{n} \left(f(A_i) - \delta_i\right)^2}.$$
#
# The least-squares cubic through the printed points must have the printed coefficients.

# %%
import numpy as np
import pandas as pd
from scipy.optimize import brentq

import workbook
from replication import characteristic, claims, figures, joint, published

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
rpm_per_rps = 60.0  # what the tables' A [rps] is multiplied by before the fit
left_out = []  # rows of Table 2 to leave out of the fit
changes = {}  # ratios of the simulated joint to multiply, such as {"K_s/J_l": 1.05}
degree = 3  # of the polynomial through our simulated peaks
criteria = {}  # limits to try in place of those of claims.csv, such as {"error_rad_small": 1e-5}

# %% jupyter={"source_hidden": true} tags=["hide-input"]
identified = joint.identified_joint()
workbook.check_parameters(
    rpm_per_rps=(rpm_per_rps, (1e-3, 1e4)),
    left_out=(left_out, [range(1, 11), []]),
    changes=(changes, dict.fromkeys(joint.ratios(identified), (0.5, 2))),
    degree=(degree, range(1, 7)),
    criteria=(criteria, dict.fromkeys(claims.OF_EQUATION_10, (-1e3, 1e3))),
)
workbook.check_parameters(**{"rows in left_out": (len(set(left_out)), range(6))})

# %% [markdown]
# ## Result
#
# ### The cubic


# %%
def polynomial(A, coefficients):  # delta [rad]; the constant's coefficient comes first
    return sum(c * np.asarray(A) ** k for k, c in enumerate(coefficients))


def fit_polynomial(A, delta_rad, degree=3):  # by least squares: coefficients and RMSE [rad]
    powers = np.asarray(A)[:, None] ** np.arange(degree + 1)
    coefficients, *_ = np.linalg.lstsq(powers, delta_rad)
    return coefficients, np.sqrt(np.mean((powers @ coefficients - delta_rad) ** 2))


# %%
delta = characteristic.printed_levels_rad()
theoretical = published.column("Table 2", "theoretical")[: delta.size]
used = ~np.isin(np.arange(1, delta.size + 1), left_out)
fitted, fitted_rmse = fit_polynomial(rpm_per_rps * theoretical[used], delta[used])
printed = 1e-6 * np.array([published.value(f"equation10.A{k}") for k in range(4)])
printed_rmse = published.value("equation10.rmse")
names = [*(f"A^{k} [1e-6 rad/rpm^{k}]" for k in range(4)), "RMSE [1e-6 rad]"]
both = {"printed": [*printed, printed_rmse], "fitted": [*fitted, fitted_rmse]}
(1e6 * pd.DataFrame(both, index=names)).map("{:.6g}".format)

# %% [markdown]
# ### The same from our own simulations
#
# The identified joint (notebook [3](03_simulator_figure10.ipynb)) at the same ten levels. In our reading $A$ is the
# largest disturbance $v - v_t$ [rps] of the [settled](glossary.md#settled) turns, before it is sampled at 2 ms.
# *Predict:* do peaks that are 1 % apart give the same coefficients?

# %%
changed = joint.change(identified, changes)
peaks = np.array(
    [
        joint.settled_peak(joint.simulate(changed, each, sample=5e-5, step=5e-5), changed)
        for each in delta
    ]
)
ours, ours_rmse = fit_polynomial(60 * peaks, delta, degree)
A_rps = np.linspace(theoretical.min(), theoretical.max(), 400)
by_ours, by_print = polynomial(60 * A_rps, ours), polynomial(60 * A_rps, printed)
apart = np.abs(by_ours - by_print).max()
workbook.show_figure(
    "figure12_characteristic",
    figures.characteristic(
        {
            "equation 10, printed": (A_rps, by_print),
            f"degree {degree} through our peaks": (A_rps, by_ours),
        },
        {"printed points": (theoretical, delta), "our simulated peaks": (peaks, delta)},
        {
            "equation 10 less printed points": (
                theoretical,
                polynomial(60 * theoretical, printed) - delta,
            ),
            "ours less equation 10": (A_rps, by_ours - by_print),
        },
    ),
    "(a) Equation 10 as printed, with A in rpm, and a polynomial through the peaks of our simulated joint at "
    f"{peaks.size} backlashes. (b) Equation 10 less the printed points, and our polynomial less equation 10.",
)

# %%
both = {"printed points": pd.Series(fitted), "simulated peaks": pd.Series(ours)}
(1e6 * pd.DataFrame(both)).rename_axis("power of A").map("{:.4g}".format)

# %% [markdown]
# ### The unit of A
#
# The tables give $A$ in rps; equation 10 is right only with rpm. The last columns are what Table 2's errors of $A$ mean
# in rad: `error_of_A` is the effect of the error of $A$ alone, `error` is against the true level.

# %%
mean = published.column("Table 2", "mean")[: delta.size]
points = pd.DataFrame({"delta": delta, "A_rps": theoretical})  # delta in rad
points["by A in rpm"] = polynomial(60 * theoretical, printed)
points["by A in rps"] = polynomial(theoretical, printed)
points["by the mean"] = polynomial(60 * mean, printed)
points["error_of_A"] = points["by the mean"] - points["by A in rpm"]
points["error"] = points["by the mean"] - delta
points.map("{:.4g}".format)

# %% [markdown]
# ### Rounded amplitudes
#
# Was the cubic fitted to the printed, rounded $A$, or to more digits of them? Each $A$ is moved at random within its
# last printed digit, and the cubic fitted again. The table has the largest change of each coefficient, in its unit of
# $10^{-6}$: where it exceeds the last printed digit, only the printed $A$ can have given the coefficient.

# %%
moves = 0.5e-4 * np.random.default_rng(1).uniform(-1, 1, size=(2000, theoretical.size))
refitted = [
    fit_polynomial(rpm_per_rps * (theoretical + move)[used], delta[used])[0] for move in moves
]
rounding_moves = 1e6 * np.abs(np.array(refitted) - fitted).max(axis=0)
by_rounding = pd.DataFrame({"printed": 1e6 * printed, "fitted": 1e6 * fitted})
by_rounding["rounding moves it by"] = rounding_moves
by_rounding.rename_axis("power of A").map("{:.6g}".format)

# %% [markdown]
# ### The tables' arithmetic and the numbers of the text
#
# `characteristic.table_arithmetic` computes the relative errors $100\,|\bar A - A| / A$ of Tables 2 and 3 from the
# printed means $\bar A$ and the printed $A$. What the text says in passing follows from tables and equation; its four
# blocks of the model are counted in the text itself.

# %%
arithmetic = characteristic.table_arithmetic()
arithmetic

# %%
bounds = published.cells("Table 1").pivot(index="row", columns="column", values="value")
error = points["error"].abs()
encoder_step = 2 * np.pi / 2 ** published.value("text.encoder_bits")
of_text = {
    "error_rad_small": error.iloc[0],
    "error_rad_large": error.max(),
    "levels": theoretical.size,
    "delta_min": points["by A in rpm"].iloc[0],
    "delta_max": points["by A in rpm"].iloc[-1],
    "delta_step": points["by A in rpm"].diff().mean(),
    "encoder_step": encoder_step,
    "error_limit_percent": published.column("Table 2", "relative_error").max(),
    "figure11_signals": theoretical.size,
    "figure12_points": theoretical.size,
    "parameters": (bounds["min"] < bounds["max"]).sum(),
    "blocks": len(("motor with encoder", "transmission", "load", "control loops")),
}

# %% [markdown]
# ## Verdict
#
# The coefficients are judged to their printed digits, which only a cubic through the printed points can give. Those of
# our own peaks are not judged: a cubic's coefficients are strongly correlated, so peaks 1 % apart give other
# coefficients and nearly the same curve.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
cells = {f"equation10.A{k}": 1e6 * fitted[k] for k in range(4)}
agreeing = (workbook.judge(cells)["verdict"] == "agrees").sum()
tables = arithmetic["element"].str.lower().str.replace(" ", "")
ids = tables + arithmetic["row"].map(".row{:02d}.relative_error".format)
cells |= dict(zip(ids, arithmetic["relative_error_percent"], strict=True))
cells |= {f"text.{name}": float(number) for name, number in of_text.items()}
cells |= {"equation10.rmse": fitted_rmse, "table2.row11.theoretical": 0.0}
decided = published.decide_all(claims.measure_equation_10(), criteria)

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
workbook.verdict(
    f"{agreeing} of 4 printed coefficients are those of the cubic through {used.sum()} printed points, of "
    f"{rpm_per_rps:g} times the tables' $A$. Its RMSE is {1e3 * fitted_rmse:.4f} mrad; printed are "
    f"{1e10 * printed_rmse:.4f}·10⁻¹⁰ rad. As printed, "
    f"with $A$ in rpm, equation 10 misses its ten points by at most "
    f"{1e3 * (points['by A in rpm'] - delta).abs().max():.2g} mrad, and Table 2's errors of $A$ mean up to "
    f"{1e3 * points['error_of_A'].abs().max():.2g} mrad. A polynomial of degree {degree} misses our simulated peaks by "
    f"{1e3 * ours_rmse:.5f} mrad (RMSE), and is at most {1e3 * apart:.2g} mrad from equation 10.",
    cells,
    decided,
    {"rounding_moves_A0": f"{rounding_moves[0]:.2f}"},
)

# %% [markdown]
# ## Try changing
#
# 1. `rpm_per_rps = 1.0`: the coefficients of the cubic in rps; all but the constant are out of their tolerance.
# 2. `left_out = [10]`: without the last point all four coefficients leave their tolerances.
# 3. `degree = 2`: a parabola misses our simulated peaks about ten times as much as a cubic does.
#
# ## Exercises
#
# Each asks for a number by its `name`. The cell below your answer says *right* or *not yet*.

# %%
inverse_mrad = rounding_mrad = limit_rps = np.nan  # your answers

# %% [markdown]
# **1.** Fit the inverse, $A$ [rpm] as a cubic of $\delta$, to the ten points. Which backlash
# (`inverse_mrad`) has $A$ = 0.6 rps? How far is it from equation 10's? Which of the two fits has
# errors in the right variable, if $A$ is what is measured?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
inverse, _ = fit_polynomial(1e3 * delta, 60 * theoretical)
inverse_mrad = brentq(lambda mrad: polynomial(mrad, inverse) - 36, 0.3, 2.1)
print(
    f"{inverse_mrad:.4f} mrad, by equation 10 {1e3 * polynomial(36.0, printed):.4f}: in the inverse A has the errors"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
of_delta = np.polyfit(1e3 * delta, theoretical, 3)
workbook.check_answer(
    inverse_mrad, lambda mrad: np.isclose(np.polyval(of_delta, mrad), 0.6, atol=5e-4)
)

# %% [markdown]
# **2.** The printed coefficients have four decimals. By how much can the rounding of the first one,
# that of $A^3$, alone move $\delta$ at the last row (`rounding_mrad`, to one digit)? Compare it with
# the RMSE of the fit.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
rounding_mrad = 1e-3 * 0.5e-4 * (60 * theoretical[-1]) ** 3
points_rmse = fit_polynomial(60 * theoretical, delta)[1]
print(f"{rounding_mrad:.3f} mrad, {1e-3 * rounding_mrad / points_rmse:.1f} times the RMSE")

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
moved = (
    polynomial(60 * theoretical[-1], [*printed[:3], printed[3] + 0.5e-10])
    - points["by A in rpm"][9]
)
workbook.check_answer(rounding_mrad, 1e3 * moved, rtol=0.1)

# %% [markdown]
# **3.** Which $A$ (`limit_rps`) does a sensor read when the backlash has reached 2 mrad? Invert
# equation 10 numerically, and see that it grows over the range, so that there is one answer.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
limit_rps = brentq(lambda A: polynomial(60 * A, printed) - 2e-3, 0, theoretical[-1])
slope = np.gradient(polynomial(60 * theoretical, printed), theoretical).min()
print(
    f"{limit_rps:.3f} rps; from the first point on the smallest slope is {1e3 * slope:.2g} mrad per rps"
)

# %% jupyter={"source_hidden": true} tags=["hide-input", "check"]
workbook.check_answer(limit_rps, lambda A: np.isclose(polynomial(60 * A, printed), 2e-3, rtol=2e-3))

# %% [markdown]
# **What you have learnt**: a formula without units can be tested on its own points, and a printed
# RMSE, too. *Next:* [the search](07_search_table1.ipynb).
