"""The paper, "A virtual sensor for backlash in robotic manipulators": read its files beside it, in this order."""

# A file imports only those before it.
READING_ORDER = (
    "published",  # every printed number; `data` has them
    "signature",  # the model of a record, and Table 1
    "misfit",  # its cost, compiled
    "cmaes",  # the search
    "joint",  # the simulator
    "records",  # records and their noise
    "table2",  # thirty runs on a record, and the table
    "characteristic",  # from the amplitude to the backlash
)
# What the paper does not have: how files are read and written, numba, the look of figures, and the least misfit of all,
# to which the search is held.
NOT_OF_THE_PAPER = ("files", "compilation", "figures", "best_fit")

# Where each equation stands. Equations 1 to 4 are 5 to 7 in absolute times, and contradict them as printed.
EQUATIONS = {
    1: "signature.d_b",
    2: "signature.f",
    3: "signature.h",
    4: "signature.h",  # T_1 and T_2 in `d_b`, T_d in `f`
    5: "signature.d_b",
    6: "signature.f",
    7: "signature.h",
    8: "joint.K_BL",
    9: "joint.tau_l",
    10: "characteristic.equation_10",  # its coefficients: data/cells.csv
    11: "signature.rmse",
    12: "cmaes.sample",
    13: "cmaes.update",
    14: "cmaes.update",
    15: "cmaes.update",
    16: "cmaes.update",
    17: "cmaes.update",
    18: "records.add_noise",
    19: "records.draw_noise",  # (A_n - A_min) / dA is twice `records.noise_half_amplitude_rps`
}
