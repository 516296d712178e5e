# %% [markdown]
# # 6 · From amplitude to backlash (equation 10, figure 12)
#
# *You will fit the sensor's characteristic, see in which unit it takes the amplitude, and what the
# printed digits can tell. Run time: 4 s. Before this: notebook [4](04_growth_figure11.ipynb).*
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

import workbook
from replication import characteristic, figures, published
from replication.simulator.parameters import changed_joint, identified_joint
from replication.simulator.simulate import simulate_many
from studies import table2_facts

# %% [markdown]
# ## Parameters

# %% tags=["parameters"]
rpm_per_rps = 60.0  # what the tables' A [rps] is multiplied by before the fit
left_out = []  # rows of Table 2 to leave out of the fit
changes = {}  # ratios of the simulated joint to multiply, such as {"stiffness_per_s2": 1.05}
degree = 3  # of the polynomial through our simulated peaks
criteria = {}  # limits to try in place of those of claims.csv, such as {"error_rad_small": 1e-5}

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.check_parameters(
    rpm_per_rps=(rpm_per_rps, workbook.Interval(1e-3, 1e4)),
    left_out=(left_out, [range(1, 11), []]),
    changes=(changes, [identified_joint().ratios]),
    degree=(degree, range(1, 7)),
    criteria=(criteria, [("error_rad_small", "error_rad_large", "monotone", "encoder_step")]),
)
if len(left_out) > 5:
    raise ValueError(f"left_out = {left_out!r}: leave out at most five of the ten rows")

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
keep = ~np.isin(np.arange(1, delta.size + 1), left_out)
fitted, fitted_rmse = fit_polynomial(rpm_per_rps * theoretical[keep], delta[keep])
printed = 1e-6 * np.array([published.value(f"equation10.A{k}") for k in range(4)])
A = np.linspace(0, theoretical[-1], 200)
points = {"printed points": (theoretical, delta)}
curves = {
    "equation 10, printed": (A, polynomial(60 * A, printed)),
    "cubic through the printed points": (A, polynomial(rpm_per_rps * A, fitted)),
}
residual = polynomial(rpm_per_rps * theoretical, fitted) - delta
workbook.show_figure(
    "figure12_characteristic",
    figures.characteristic(curves, points, {"cubic less printed points": (theoretical, residual)}),
    f"(a) Equation 10 as printed, with A in rpm, and the cubic through {keep.sum()} printed points. (b) The cubic's "
    f"residuals, with an RMSE of {fitted_rmse:.2g} rad.",
)

# %%
printed_rmse = published.value("equation10.rmse")
names = [*(f"A^{k} [1e-6 rad/rpm^{k}]" for k in range(4)), "RMSE [1e-6 rad]"]
both = {"printed": [*printed, printed_rmse], "fitted": [*fitted, fitted_rmse]}
(1e6 * pd.DataFrame(both, index=names)).map("{:.6g}".format)

# %% [markdown]
# ### The same from our own simulations
#
# The identified joint (notebook 9) at the same ten levels. In our reading $A$ is the largest
# disturbance $v - v_t$ [rps] of the [settled](glossary.md#settled) turns, before it is sampled at 2
# ms; $v$ is the motor's speed, and $v_t$ the commanded one.

# %%
joint = changed_joint(identified_joint(), changes)
runs = simulate_many(joint, delta, sample_s=5e-5, step_s=5e-5)  # forty samples in 2 ms
settled = runs[0].time_s >= joint.turn_period_s
disturbances = np.array([run.motor_speed_rps[settled] - joint.commanded_speed_rps for run in runs])
peaks = disturbances.max(axis=1)
ours, ours_rmse = fit_polynomial(60 * peaks, delta, degree)

# %%
A_rps = np.linspace(theoretical.min(), theoretical.max(), 400)
difference = pd.DataFrame({"amplitude_rps": A_rps, "fitted_rad": polynomial(60 * A_rps, ours)})
difference["printed_rad"] = polynomial(60 * A_rps, printed)
difference["difference_rad"] = difference["fitted_rad"] - difference["printed_rad"]
largest_difference = difference["difference_rad"].abs().max()
curves = {
    "equation 10, printed": (A_rps, difference["printed_rad"]),
    f"degree {degree} through our simulated peaks": (A_rps, difference["fitted_rad"]),
}
residuals = {
    "equation 10 less printed points": (theoretical, polynomial(60 * theoretical, printed) - delta),
    "ours less equation 10": (A_rps, difference["difference_rad"]),
}
workbook.show_figure(
    "figure12_simulated",
    figures.characteristic(curves, points | {"our simulated peaks": (peaks, delta)}, residuals),
    f"(a) Equation 10 as printed, and the cubic through the peaks of our simulated joint at {peaks.size} backlashes. "
    f"(b) They differ by at most {1e3 * largest_difference:.2g} mrad, though their coefficients differ.",
)

# %%
both = {"printed points": pd.Series(fitted), "simulated points": pd.Series(ours)}
(1e6 * pd.DataFrame(both)).rename_axis("power of A").map("{:.4g}".format)

# %% [markdown]
# ### The unit of A
#
# The tables give $A$ in rps; equation 10 is right only with rpm.

# %%
units = pd.DataFrame({"delta_rad": delta, "A_rps": theoretical})
units["equation 10 with A in rpm"] = by_equation = polynomial(60 * theoretical, printed)
units["equation 10 with A in rps"] = polynomial(theoretical, printed)
units.map("{:.4g}".format)

# %% [markdown]
# ### Rounded amplitudes
#
# Was the cubic fitted to the printed, rounded $A$, or to more digits of them? Each $A$ is moved at
# random within its last printed digit, and the cubic fitted again: `rounding moves it by` is the
# largest change of each coefficient, in its unit of $10^{-6}$. Only the printed digits give the
# printed coefficients.

# %%
rng = np.random.default_rng(1)
moves = 0.5e-4 * rng.uniform(-1, 1, size=(2000, theoretical.size))
refitted = [
    fit_polynomial(rpm_per_rps * (theoretical + move)[keep], delta[keep])[0] for move in moves
]
rounding_moves = 1e6 * np.abs(np.array(refitted) - fitted).max(axis=0)
by_rounding = pd.DataFrame({"printed": 1e6 * printed, "fitted to printed A": 1e6 * fitted})
by_rounding["rounding moves it by"] = rounding_moves
by_rounding.rename_axis("power of A").map("{:.6g}".format)

# %% [markdown]
# ### What Table 2's errors of A mean in rad
#
# `error_of_A_rad` is the effect of the error in $A$ alone; `error_rad` is against the true level,
# with the cubic's own misfit.

# %%
mean = published.column("Table 2", "mean")[: delta.size]
estimated = polynomial(60 * mean, printed)
errors = pd.DataFrame({"delta_rad": delta, "printed_mean_A_rps": mean})
errors["error_of_A_rad"] = estimated - by_equation
errors["error_rad"] = estimated - delta
errors.map("{:.4g}".format)

# %% [markdown]
# ### The tables' arithmetic
#
# Every printed relative error [%] follows from the printed mean within the rounding of the mean.
# `characteristic.table_arithmetic` computes $100\,|\bar A - A| / A$ of every row of Tables 2 and 3,
# with the mean $\bar A$ and the known $A$ as printed.

# %%
arithmetic = characteristic.table_arithmetic()
arithmetic

# %% [markdown]
# ### Numbers of the text
#
# What the text says in passing, and what the printed tables and equation give; the four blocks of
# the model are counted in the text itself.

# %%
bounds = published.cells("Table 1").pivot(index="row", columns="column", values="value")
encoder_step_rad = 2 * np.pi / 2 ** published.value("text.encoder_bits")
of_text = {
    "error_rad_small": errors["error_rad"].abs().iloc[0],
    "error_rad_large": errors["error_rad"].abs().max(),
    "levels": theoretical.size,
    "delta_min": by_equation[0],
    "delta_max": by_equation[-1],
    "delta_step": np.diff(by_equation).mean(),
    "encoder_step": encoder_step_rad,
    "error_limit_percent": published.column("Table 2", "relative_error").max(),
    "figure11_signals": theoretical.size,
    "figure12_points": theoretical.size,
    "parameters": (bounds["min"] < bounds["max"]).sum(),
    "blocks": len(("motor with encoder", "transmission", "load", "control loops")),
}
text_cells = {f"text.{name}": number for name, number in of_text.items()}
workbook.judge(text_cells)

# %% [markdown]
# ## Verdict
#
# The coefficients are judged to their printed digits, which only a cubic through the printed points
# can give. Those of our own peaks are shown above and not judged: a cubic's coefficients are
# strongly correlated, so peaks 1 % apart give other coefficients and nearly the same curve.

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
error = errors["error_rad"].abs()
A_rps = np.linspace(0, theoretical.max(), 1000)
slope = np.gradient(polynomial(60 * A_rps, printed), A_rps).min()
smallest = f"{error.iloc[0]:.2g} rad at {delta[0]:.0e} rad"
largest = (
    f"the largest error is {error.max():.2g} rad, at {delta[error.idxmax()]:.1e} rad; the number of the text is read "
    "as an upper bound, and is not the largest error itself"
)
rising = f"the smallest slope over the range of the points is {slope:.2g} rad per rps"
resolved = f"one step of the encoder is {encoder_step_rad:.3g} rad"
claims = {
    "error_rad_small": (published.decide("error_rad_small", error.iloc[0], criteria), smallest),
    "error_rad_large": (published.decide("error_rad_large", error.max(), criteria), largest),
    "monotone": (published.decide("monotone", slope, criteria), rising),
    "encoder_step": (published.decide("encoder_step", encoder_step_rad, criteria), resolved),
}

# %% jupyter={"source_hidden": true} tags=["hide-input", "verdict"]
of_equation = {f"equation10.A{k}": 1e6 * fitted[k] for k in range(4)}
by_table = arithmetic["element"].str.lower().str.replace(" ", "")
ids = by_table + arithmetic["row"].map(".row{:02d}.relative_error".format)
of_arithmetic = dict(zip(ids, arithmetic["relative_error_percent"], strict=True))
cells = of_equation | of_arithmetic | text_cells
cells |= {"equation10.rmse": fitted_rmse, "table2.row11.theoretical": 0.0}
agreeing = (workbook.judge(of_equation)["verdict"] == "agrees").sum()
off = np.abs(by_equation - delta).max()
of_rows = (
    f"{keep.sum()} of {keep.size} printed points" if left_out else f"the {keep.size} printed points"
)
workbook.verdict(
    f"{agreeing} of the {len(of_equation)} printed coefficients are those of the least-squares cubic through "
    f"{of_rows}, of {rpm_per_rps:g} times the tables' $A$. Its RMSE is {fitted_rmse:.3g} rad, not "
    f"{printed_rmse:.4e} rad. As printed, with $A$ in rpm, equation 10 misses its ten points by at most "
    f"{1e3 * off:.2g} mrad, and Table 2's "
    f"errors of $A$ mean errors of delta of up to {1e3 * errors['error_of_A_rad'].abs().max():.2g} mrad. A polynomial "
    f"of degree {degree} misses our simulated peaks by {ours_rmse:.2g} rad (RMSE); it is nowhere more than "
    f"{1e3 * largest_difference:.2g} mrad from equation 10.",
    cells,
    claims,
)

# %% jupyter={"source_hidden": true} tags=["hide-input"]
workbook.export(
    supplement={
        "characteristic_difference": (difference.iloc[::20], "Our cubic less equation 10."),
        "equation10_units": (units, "Equation 10 at the printed A, in rpm and rps."),
    },
    facts=table2_facts.of_equation10(fitted_rmse, rounding_moves, units, errors),
    cells=cells,
    claims=claims,
)

# %% [markdown]
# ## Try changing
#
# 1. `rpm_per_rps = 1.0`: the coefficients of the cubic in rps; all but the constant are out of
#    their tolerance.
# 2. `left_out = [10]`: without the last point all four coefficients change, by 10 to 42 %, and
#    leave their tolerances.
# 3. `degree = 2`: a parabola misses our simulated peaks by 4.5·10⁻⁶ rad, eleven times as much as a
#    cubic, and about as much as the cubic misses the printed points: their rounding hides the third
#    degree.
#
# ## Exercises
#
# **1.** Fit the inverse, $A$ [rpm] as a cubic of $\delta$, to the ten points, and read the backlash
# off it at $A$ = 0.6 rps by bisection. How far is it from equation 10's (in rad, to two digits)?
# Which of the two fits has errors in the right variable, if $A$ is what is measured?

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
inverse, _ = fit_polynomial(1e4 * delta, 60 * theoretical)
low, high = delta[0], delta[-1]
for _ in range(50):
    middle = (low + high) / 2
    low, high = (middle, high) if polynomial(1e4 * middle, inverse) < 36 else (low, middle)
apart = low - polynomial(36.0, printed)
assert abs(apart) < 3 * fit_polynomial(60 * theoretical, delta)[1]
print(f"{apart:.1e} rad: within the fit's misfit; the inverse has the errors of A where they arise")

# %% [markdown]
# **2.** The printed coefficients have four decimals. How far can their rounding alone move $\delta$
# at the last row (in rad, to one digit)? Compare it with the RMSE of the fit.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
rounding_rad = 1e-6 * 0.5e-4 * (60 * theoretical[-1]) ** np.arange(4)
print("from A^0 to A^3:", ", ".join(f"{each:.1e} rad" for each in rounding_rad))
points_rmse = fit_polynomial(60 * theoretical, delta)[1]
assert rounding_rad[3] > 2 * points_rmse > 1000 * printed_rmse

# %% [markdown]
# **3.** A sensor reads $A$ = 0.9 rps. Which backlash is it? And which $A$ will it read when the
# backlash has reached 2·10⁻³ rad (to 0.001 rps)? Invert equation 10 numerically, and check that it
# grows over the range, so that there is one answer.

# %% jupyter={"source_hidden": true} tags=["hide-cell", "solution"]
roots = np.roots([*printed[:0:-1], printed[0] - 2e-3]) / 60
real = roots[np.abs(roots.imag) < 1e-9].real
(A_limit,) = real[(real > 0) & (real < theoretical[-1])]
assert np.isclose(polynomial(60 * A_limit, printed), 2e-3)
assert slope > 0
print(f"{polynomial(54.0, printed):.2e} rad; {A_limit:.3f} rps")

# %% [markdown]
# **What you have learnt**: a formula without units can be tested on its own points, and a printed
# RMSE, too. *Next:* [the search](07_protocol_table1.ipynb).
