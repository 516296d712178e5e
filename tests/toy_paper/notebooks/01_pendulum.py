# %% [markdown]
# # 1 · A pendulum of one metre
#
# The paper prints its period, and how much longer a wide swing takes.

# %%
import math

import workbook

# %% tags=["parameters"]
length_m = 1.0
wide_deg = 60


# %% [markdown]
# By the arithmetic-geometric mean a swing of amplitude $\theta$ takes
# $2\pi\sqrt{l/g}\,/\,\mathrm{agm}(1, \cos(\theta/2))$.


# %%
def period_s(swing_deg):
    a, b = 1.0, math.cos(math.radians(swing_deg) / 2)
    for _ in range(6):
        a, b = (a + b) / 2, math.sqrt(a * b)
    return 2 * math.pi * math.sqrt(length_m / 9.81) / a


small_s = period_s(0)
slower_percent = 100 * (period_s(wide_deg) / small_s - 1)
change = period_s(5) / small_s - 1

# %%
workbook.verdict(
    f"A small swing takes {small_s:.3f} s, one of {wide_deg}° {slower_percent:.1f} % longer.",
    cells={"text.period": small_s, "text.slower": slower_percent},
    claims={"small_swings": (change, f"a swing of 5° takes {change:.1e} longer")},
    facts={"wide_deg": wide_deg},
)
