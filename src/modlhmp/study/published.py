"""Published numbers beside ours: the paper's own, by dataset labels and `paper_results`, and those of the DSR paper."""

# ADE / FDE [m] of the paper's results table, and the horizons [s] that they are at.
RESULTS_AT_S = {"atc": 60, "edinburgh": 20}
RESULTS = {
    "atc": {
        "tc_cliff": (5.332, 11.215), "cliff": (5.557, 11.736), "stef": (6.026, 12.633),
        "trajectronpp": (11.844, 27.399), "mid": (21.124, 44.373), "tutr": (12.127, 26.739),
        "social_lstm": (12.704, 28.086), "lstm": (12.975, 28.773), "cvm": (16.191, 35.108),
    },
    "edinburgh": {
        "tc_cliff": (3.035, 5.787), "cliff": (3.094, 5.830), "stef": (3.064, 5.847),
        "trajectronpp": (3.810, 4.897), "mid": (5.621, 7.031), "tutr": (3.375, 4.432),
        "social_lstm": (3.835, 5.195), "lstm": (3.835, 5.201), "cvm": (7.919, 17.112),
    },
}  # fmt: skip

SHORT_S = {"atc": 10.0, "edin": 5.0}  # the results section's "short-term"
PERCENTILE_S = {"atc": 60.0, "edin": 20.0}  # 90th percentiles of track length

# Runtime analysis: TC-CLiFF, k = 5, on a laptop with an Intel Core i7-1185G7.
SECONDS_PER_TRACK = {"atc": 0.11, "edin": 0.04}
MEMORY_MB, MAP_KB = 273.0, 152.0

# Edinburgh at ten positions per second, 2.0 s ahead: mean ADE / FDE [m] of a forecast's samples by their weights (wADE,
# wFDE), and how many samples, as the DSR paper prints them (+ DSR: with its resampling by goals). The protocol is
# that of Z. Huang et al., IEEE RA-L 2020 (MIF-WLSTM): 3,719 test tracks of a split that is not public, 86,404
# forecasts, one each 0.2 s from 3.0 s on while 2.0 s remain. Constant velocity is not among them.
STEP_S, AHEAD_S = 0.1, 2.0
SHORT = {
    "MIF": (64, 0.6594, 1.2420), "MIF, more samples": (340, 0.6051, 1.1404), "MIF + DSR": (64, 0.5713, 1.0768),
    "CLiFF-LHMP": (64, 0.5542, 1.1194), "CLiFF + GoalBridge": (64, 0.5319, 1.0638),
    "CLiFF + GoalBridge + DSR": (64, 0.5264, 1.0493),
    "PPT": (20, 1.0931, 2.4961), "PPT + DSR": (20, 1.0024, 2.2842),
    "GDTS, causal": (20, 0.4925, 0.9615), "GDTS, causal + DSR": (20, 0.4563, 0.8947),
    "Social Informer": (20, 0.4951, 0.9683), "Social Informer + DSR": (20, 0.4513, 0.8874),
    "PECNet": (20, 0.4916, 1.0554), "PECNet + DSR": (20, 0.3709, 0.7675),
}  # fmt: skip
