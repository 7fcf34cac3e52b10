"""The paper's own numbers, which stand beside ours; dataset labels and `paper_results` as in the dataset files."""

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
