"""Words of captions and notes that say the same of several exhibits."""

SEED_MEANS = "the mean of the seeds' own means"
OVER = "over days where there are five test days or more, else over persons"  # `comparisons.clusters`
